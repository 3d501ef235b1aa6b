import json
import threading
from pathlib import Path

import pytest

from palpate.common.errors import InputError, Unavailable
from palpate.studies.efficiency import Rate
from palpate.studies.trials import PlannerTrial, TrialRecord, read_records, run_trials, table

TRIALS = [
    PlannerTrial("cup", planner, configuration, number)
    for planner in ("a:1", "b:2")
    for configuration in ("full", "no role")
    for number in range(3)
]


def good(trial: PlannerTrial) -> TrialRecord:
    return TrialRecord(
        trial,
        True,
        True,
        trial.number != 2,
        "" if trial.number != 2 else "slipped",
        {"input_tokens": 100, "output_tokens": 20, "cost_usd": 0.01},
    )


def test_every_trial_is_made_once_and_kept(tmp_path: Path) -> None:
    file = tmp_path / "results.jsonl"
    records = run_trials(TRIALS, good, file, in_flight=3)
    assert [r.trial for r in records] == TRIALS
    assert {r.trial for r in read_records(file)} == set(TRIALS)
    assert len(file.read_text().splitlines()) == len(TRIALS)


def test_several_are_in_flight_but_no_more_than_asked(tmp_path: Path) -> None:
    lock, now, most = threading.Lock(), 0, 0
    four = threading.Barrier(4, timeout=60)

    def slow(trial: PlannerTrial) -> TrialRecord:
        nonlocal now, most
        with lock:
            now += 1
            most = max(most, now)
        four.wait()
        with lock:
            now -= 1
        return good(trial)

    run_trials(TRIALS, slow, tmp_path / "r.jsonl", in_flight=4)
    assert most == 4


def test_a_killed_study_goes_on_where_it_was(tmp_path: Path) -> None:
    file = tmp_path / "r.jsonl"
    run_trials(TRIALS[:5], good, file)
    with file.open("a") as torn:
        torn.write('{"trial": {"scenario": "cup", "pla')
    asked: list[PlannerTrial] = []

    def again(trial: PlannerTrial) -> TrialRecord:
        asked.append(trial)
        return good(trial)

    records = run_trials(TRIALS, again, file)
    assert sorted(asked) == sorted(TRIALS[5:])
    assert [r.trial for r in records] == TRIALS
    assert all(json.loads(line) for line in file.read_text().splitlines())


def test_an_outage_keeps_what_is_done_and_says_so(tmp_path: Path) -> None:
    file, asked = tmp_path / "r.jsonl", list[PlannerTrial]()

    def out(trial: PlannerTrial) -> TrialRecord:
        asked.append(trial)
        if trial.planner == "b:2":
            raise Unavailable("b:2: the key was refused")
        return good(trial)

    with pytest.raises(Unavailable, match=r"key was refused.*run the study again"):
        run_trials(TRIALS, out, file, in_flight=1)
    assert len(read_records(file)) == 6
    assert len(asked) == 6 + 3


def test_a_single_outage_is_asked_again_next_time(tmp_path: Path) -> None:
    file, failed = tmp_path / "r.jsonl", list[PlannerTrial]()

    def flaky(trial: PlannerTrial) -> TrialRecord:
        if trial == TRIALS[1] and not failed:
            failed.append(trial)
            raise Unavailable("a:1: the provider failed")
        return good(trial)

    with pytest.raises(Unavailable):
        run_trials(TRIALS, flaky, file, in_flight=1)
    assert {r.trial for r in read_records(file)} == set(TRIALS) - {TRIALS[1]}
    assert [r.trial for r in run_trials(TRIALS, flaky, file)] == TRIALS


def test_another_file_is_not_taken_for_results(tmp_path: Path) -> None:
    file = tmp_path / "notes.txt"
    file.write_text("my notes\n")
    with pytest.raises(InputError, match=r"notes.*--out"):
        run_trials(TRIALS, good, file)
    assert file.read_text() == "my notes\n"


def test_the_table_has_a_row_for_each_configuration_and_planner() -> None:
    rows = table(
        [good(t) for t in TRIALS]
        + [TrialRecord(PlannerTrial("cup", "c:3", "no text", 0), False, False, None)]
    )
    assert [(r.configuration, r.planner) for r in rows] == [
        ("full", "a:1"),
        ("no role", "a:1"),
        ("full", "b:2"),
        ("no role", "b:2"),
        ("no text", "c:3"),
    ]
    assert (rows[0].syntax, rows[0].success, rows[0].tokens) == (Rate(3, 3), Rate(2, 3), 120)
    assert rows[0].cost == pytest.approx(0.03)
    assert (rows[4].success, rows[4].cost) == (None, None)
