"""`palpate study accuracy`: a campaign that is kept, gone on with, and shown."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from palpate.common.parameter import Parameter
from palpate.runs.settings import Settings
from palpate.studies import accuracy
from palpate.studies.accuracy import ScoredEstimate, SeedRun

MASS = Parameter("green_bottle", "mass")


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[Settings]:
    """The settings of the runs that were asked for; they are made up."""
    result: list[Settings] = []

    def made_up(
        settings: Settings, seed: int, displaced: bool, shared: accuracy.PreparedStudy | None
    ) -> SeedRun:
        assert displaced
        assert shared is not None
        result.append(settings)
        value = 0.187 + 1e-3 * (seed % 2)
        ends = (value - 2e-3, value + 2e-3)
        item = ScoredEstimate(MASS, 0, seed, value, 1e-3, *ends, 0.187, 0.2, "kg")
        return SeedRun(seed, "complete", 12, 17.0, (item,))

    monkeypatch.setattr(accuracy, "run_seed", made_up)
    return result


def test_seeds_are_kept_and_gone_on_with(
    palpate: Callable[..., Any], asked: list[Settings], tmp_path: Path
) -> None:
    study = ("study", "accuracy", "one_missing_mass", "--workers", 1, "--out", "kept")
    answer = palpate(*study, "--first-seed", 5000, "--seeds", 2)
    assert answer.status == 0
    assert "green_bottle.mass" in answer.out
    assert "2/2 · " in answer.err
    assert max(map(len, answer.out.splitlines())) <= 80
    answer = palpate(*study, "--first-seed", 5000, "--seeds", 3, "--json")
    assert len(asked) == 3
    (result,) = json.loads(answer.out)["scenarios"]
    assert (result["scenario"], result["statuses"]) == ("one_missing_mass", {"complete": 3})
    (row,) = result["rows"]
    assert row["parameter"] == {"object": "green_bottle", "quantity": "mass"}
    assert (row["runs"], row["asked"], row["covered"]) == (3, 3, 3)
    assert row["bias"] == pytest.approx(1e-3 / 3)
    assert row["scores"]["coverage95"]["value"] == 1.0
    assert "green_bottle.mass" in (tmp_path / "kept" / "index.html").read_text(encoding="utf-8")


def test_an_interrupted_study_keeps_and_shows_finished_seeds(
    palpate: Callable[..., Any],
    asked: list[Settings],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made_up = accuracy.run_seed

    def interrupted(settings: Settings, seed: int, **more: Any) -> SeedRun:
        if seed == 2:
            raise KeyboardInterrupt
        return made_up(settings, seed, **more)

    monkeypatch.setattr(accuracy, "run_seed", interrupted)
    study = ("study", "accuracy", "one_missing_mass", "--workers", 1, "--out", "kept")
    assert palpate(*study, "--seeds", 5).status == 4
    assert len((tmp_path / "kept" / "rows.jsonl").read_text(encoding="utf-8").splitlines()) == 2
    assert "2 runs in simulated worlds" in (tmp_path / "kept" / "index.html").read_text(
        encoding="utf-8"
    )


def test_other_settings_are_refused_in_the_words_of_the_command_line(
    palpate: Callable[..., Any], asked: list[Settings]
) -> None:
    study = ("study", "accuracy", "one_missing_mass", "--seeds", 1, "--workers", 1, "--out", "kept")
    palpate(*study)
    answer = palpate(*study, "-r", "the mass of the bottle", "--within", "mass=1g")
    assert answer.status == 2
    assert "another request and within; choose another --out" in answer.err
    assert len(asked) == 1


def test_runs_are_asked_what_the_options_say(
    palpate: Callable[..., Any], asked: list[Settings]
) -> None:
    options = ("-r", "the mass of the bottle", "--within", "mass=1g", "--noise", "none")
    palpate("study", "accuracy", "one_missing_mass", *options, "--seeds", 1, "--workers", 1)
    (settings,) = asked
    assert (settings.request, settings.noise) == ("the mass of the bottle", "none")
    assert dict(settings.within) == {"mass": 1e-3}


def test_a_cluster_that_is_not_there_is_unavailable(palpate: Callable[..., Any]) -> None:
    answer = palpate("study", "accuracy", "--cluster", "127.0.0.1:9")
    assert (answer.status, "no Ray cluster at '127.0.0.1:9'" in answer.err) == (5, True)
    answer = palpate("study", "accuracy", "--cluster", "somewhere")
    assert (answer.status, "HOST:PORT" in answer.err) == (2, True)
