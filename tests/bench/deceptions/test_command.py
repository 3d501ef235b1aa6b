"""`python -m bench deceptions`: what was answered in which world."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import Result

from bench.campaign.ledger import Row
from bench.deceptions import study


def judge(case: study.Case, blank: Row, traces: Path | None = None) -> Row:
    score = {"parameter": "mat.stiffness", "verdict": "identified", "z": 7.0, "covered": False}
    figures = {"world": case.world, "kind": "deceptive", "scores": [score]}
    outcome, beyond = "fooled", ("7 std",)
    return replace(blank, command="palpate …", outcome=outcome, beyond=beyond, figures=figures)


def test_the_command_shows_the_deceived_estimators(
    instrument: Callable[..., Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(study, "judge", judge)
    ask = ("deceptions", "coin in the mat", "--workers", 1, "--out", tmp_path / "out")
    answer = instrument(*ask, "--noise", "lab", "--noise", "sticky_joints", "--seeds", 2)
    assert answer.exit_code == 0
    assert "fooled 4" in answer.output
    assert "palpate …: 7 std" in answer.output
    assert "coin in the mat" in (tmp_path / "out" / "deceptions.html").read_text()
    answer = instrument(*ask, "--json")
    shown = json.loads(answer.output)
    assert shown["coverage"][0]["farthest"] == 1
    assert shown["rows"][0]["outcome"] == "fooled"


def test_unknown_worlds_are_bad_input(instrument: Callable[..., Result], tmp_path: Path) -> None:
    answer = instrument("deceptions", "a flood", "--out", tmp_path / "out")
    assert (answer.exit_code, "hard board" in answer.output) == (2, True)
