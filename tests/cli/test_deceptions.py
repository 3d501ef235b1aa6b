"""`palpate study deceptions`: what was answered in which world."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from palpate.studies.campaign.ledger import Row
from palpate.studies.deceptions import study


def judged(case: study.Case, traces: Path | None = None) -> Row:
    score = {"parameter": "mat.stiffness", "verdict": "identified", "z": 7.0, "covered": False}
    figures = {"world": case.world, "kind": "deceptive", "scores": [score]}
    return Row(
        "deceptions", case.name, "", "palpate …", "fooled", beyond=("7 std",), figures=figures
    )


def test_who_is_fooled_is_shown(
    palpate: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(study, "judged", judged)
    ask = ("study", "deceptions", "coin in the mat", "--workers", 1, "--out", tmp_path / "out")
    answer = palpate(*ask, "--noise", "lab", "--noise", "sticky_joints", "--seeds", 2)
    assert answer.status == 0
    assert "fooled 4" in answer.out
    assert "palpate …: 7 std" in answer.out
    assert "coin in the mat" in (tmp_path / "out" / "deceptions.html").read_text()
    answer = palpate(*ask, "--json")
    shown = json.loads(answer.out)
    assert shown["coverage"][0]["farthest"] == 1
    assert shown["rows"][0]["outcome"] == "fooled"


def test_worlds_that_nobody_knows_are_bad_input(
    palpate: Callable[..., Any], tmp_path: Path
) -> None:
    answer = palpate("study", "deceptions", "a flood", "--out", tmp_path / "out")
    assert (answer.status, "hard board" in answer.err) == (2, True)
