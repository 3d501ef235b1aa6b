"""A campaign that goes on: what is in the folder is not run again, and is never mixed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import Any

import pytest

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.studies.accuracy import MissingComponent, Question, ScoredEstimate, SeedRun, StudyCase
from palpate.studies.summary import FILE, Group, measure, read
from palpate.studies.workers import Processes, WorkerLost

MASS = Parameter("cup", "mass")
LAB = Question("one_missing_mass", (("noise", "lab"),))
NONE = Question("one_missing_mass", (("noise", "none"),))


def made_up(case: StudyCase) -> SeedRun:
    """A run without a robot."""
    seed = case.seed
    value = 0.3 + 0.001 * seed
    sure = ScoredEstimate(MASS, 0, seed, value, 0.01, value - 0.02, value + 0.02, 0.3, None, "kg")
    unknown = MissingComponent(Parameter("cup", "friction"), 0, seed, 0.5, "1", "never slid")
    return SeedRun(seed, "failed", 12, 20.0, (sure,), (), (unknown,))


@dataclass
class Pretenders:
    """A crew that runs nothing, the last task first, and loses `fatal`."""

    fatal: int | None = None
    asked: list[int] = field(default_factory=list[int])

    def each(
        self, work: Callable[[Any], Any], tasks: Sequence[Any]
    ) -> Iterator[tuple[int, SeedRun | WorkerLost]]:
        for place, case in reversed(list(enumerate(tasks))):
            self.asked.append(case.seed)
            gone = case.seed == self.fatal
            yield place, WorkerLost("it is gone") if gone else made_up(case)


def test_runs_come_back_as_they_were(tmp_path: Path) -> None:
    messages: list[str] = []
    first = measure([LAB], range(3), Pretenders(), tmp_path, messages.append)
    crew = Pretenders()
    again = measure([LAB], range(5), crew, tmp_path, messages.append)
    group = Group("one_missing_mass", "lab")
    assert list(first) == list(again) == [group]
    assert first[group] == [made_up(StudyCase(LAB, seed)) for seed in range(3)]
    assert again[group][:3] == first[group]
    assert sorted(crew.asked) == [3, 4]
    assert messages[0] == "0/3"
    assert messages[4] == "3/5"
    assert messages[-1].startswith("5/5 · ")


def test_rows_are_there_the_moment_a_run_is_done(tmp_path: Path) -> None:
    class Interrupted(Pretenders):
        def each(self, *given: Any) -> Iterator[tuple[int, SeedRun | WorkerLost]]:
            for number, result in enumerate(super().each(*given)):
                if number == 2:
                    raise KeyboardInterrupt
                yield result

    with pytest.raises(KeyboardInterrupt):
        measure([LAB], range(5), Interrupted(), tmp_path)
    assert [row.run.seed for row in read(tmp_path)] == [4, 3]


def test_noises_and_scenarios_share_a_folder(tmp_path: Path) -> None:
    measure([LAB], range(1), Pretenders(), tmp_path)
    runs_by_group = measure([NONE, LAB], range(1), Pretenders(), tmp_path)
    assert [group.noise for group in runs_by_group] == ["none", "lab"]
    assert len(read(tmp_path)) == 2


def test_a_study_without_a_folder_keeps_nothing() -> None:
    assert len(measure([LAB], range(2), Pretenders())[Group("one_missing_mass", "lab")]) == 2


def test_a_run_that_takes_its_process_with_it_is_a_row(tmp_path: Path) -> None:
    measure([LAB], range(3), Pretenders(fatal=1), tmp_path)
    (row,) = [row for row in read(tmp_path) if row.run.status == "crashed"]
    assert (row.run.seed, row.run.crash, row.run.estimates) == (1, "it is gone", ())


def test_a_run_that_crashes_is_a_row_with_its_traceback(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def burst(*_: object) -> None:
        raise ZeroDivisionError("the arm is nowhere")

    monkeypatch.setattr("palpate.runs.pipeline.plan", burst)
    runs_by_group = measure([LAB], [7], Processes(1), tmp_path)
    (run,) = runs_by_group[Group("one_missing_mass", "lab")]
    assert (run.seed, run.status) == (7, "crashed")
    assert "ZeroDivisionError: the arm is nowhere" in run.crash


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"request": "the mass of the bottle"}, "request"),
        ({"planner": "exhaustive", "cautious": True}, "cautious and planner"),
    ],
)
def test_runs_of_other_settings_are_refused(
    tmp_path: Path, changes: dict[str, Any], what: str
) -> None:
    measure([LAB], range(1), Pretenders(), tmp_path)
    before = (tmp_path / FILE).read_bytes()
    other = Question(LAB.scenario, (*LAB.changes, *changes.items()))
    with pytest.raises(InputError, match=f"at lab with another {what}; choose another out="):
        measure([other], range(2), Pretenders(), tmp_path)
    assert (tmp_path / FILE).read_bytes() == before


def test_another_noise_file_of_the_same_name_is_refused(tmp_path: Path) -> None:
    noise = tmp_path / "mine.yaml"
    question = Question(LAB.scenario, (("noise", str(noise)),))
    noise.write_text("palpate_noise: 1\nextends: lab\n", encoding="utf-8")
    measure([question], range(1), Pretenders(), tmp_path / "out")
    noise.write_text("palpate_noise: 1\nextends: datasheet\n", encoding="utf-8")
    with pytest.raises(InputError, match="at mine with another noise"):
        measure([question], range(1), Pretenders(), tmp_path / "out")


def test_an_interval_without_an_end_comes_back(tmp_path: Path) -> None:
    boundless = ScoredEstimate(MASS, 0, 0, 0.3, inf, -inf, inf, 0.3, None, "kg", "prior-dominated")
    run = SeedRun(0, "failed", 12, 20.0, (), (boundless,))

    class Once(Pretenders):
        def each(self, *_: Any) -> Iterator[tuple[int, SeedRun | WorkerLost]]:
            yield 0, run

    measure([LAB], [0], Once(), tmp_path)
    (row,) = read(tmp_path)
    assert row.run == run


def test_bad_settings_are_bad_input_before_anything_runs(tmp_path: Path) -> None:
    crew = Pretenders()
    with pytest.raises(InputError, match="unknown noise 'loud'"):
        measure([Question(LAB.scenario, (("noise", "loud"),))], range(1), crew, tmp_path)
    assert crew.asked == []


def test_another_file_is_not_taken_for_rows(tmp_path: Path) -> None:
    (tmp_path / FILE).write_text('{"case": 1}\n', encoding="utf-8")
    with pytest.raises(InputError, match=r"rows\.jsonl.*--out"):
        read(tmp_path)
