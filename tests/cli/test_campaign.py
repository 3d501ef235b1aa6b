"""`palpate study faults --kind …`: campaigns, and their cases again."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from palpate.studies.campaign import campaign
from palpate.studies.campaign.ledger import Row


def test_one_case_is_repeated(palpate: Callable[..., Any]) -> None:
    answer = palpate("study", "faults", "--kind", "nasty", "--case", "six angles")
    assert answer.status == 0
    assert "MoveJoints needs 7 angles" in answer.out
    answer = palpate("study", "faults", "--kind", "nasty", "--case", "six angles", "--json")
    assert json.loads(answer.out)["outcome"] == "refused"


def test_a_campaign_needs_a_folder_and_a_kind(palpate: Callable[..., Any], tmp_path: Path) -> None:
    answer = palpate("study", "faults", "--kind", "nasty")
    assert (answer.status, "--out" in answer.err) == (2, True)
    answer = palpate("study", "faults", "--kind", "floods", "--out", tmp_path)
    assert (answer.status, "mishaps" in answer.err) == (2, True)


def test_a_campaign_shows_what_was_beyond(
    palpate: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    row = Row("nasty", "deep", "too deep", "palpate study …", "complete", beyond=("table hit",))

    def judge(*_: object) -> list[Row]:
        return [row]

    monkeypatch.setattr(campaign.nasty, "judge_nasty", judge)
    answer = palpate("study", "faults", "--kind", "nasty", "--out", tmp_path)
    assert answer.status == 0
    assert "palpate study …: table hit" in answer.out
    assert (tmp_path / "campaign.html").exists()
