"""`python -m bench faults --kind …`: campaigns, and their cases again."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import Result

from bench.campaign import kinds
from bench.campaign.ledger import Row
from bench.faults.nasty import Written


def test_the_command_repeats_a_single_case(instrument: Callable[..., Result]) -> None:
    answer = instrument("faults", "--kind", "nasty", "--case", "six angles")
    assert answer.exit_code == 0
    assert "MoveJoints needs 7 angles" in answer.output
    answer = instrument("faults", "--kind", "nasty", "--case", "six angles", "--json")
    assert json.loads(answer.output)["outcome"] == "refused"


def test_written_plans_are_executed_by_an_arm_of_the_seed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each seed has rows of its own in a folder."""
    drawn: list[int] = []

    def judge(case: Written, blank: Row) -> Row:
        drawn.append(case.seed)
        return blank

    monkeypatch.setitem(kinds.KINDS, "nasty", replace(kinds.KINDS["nasty"], work=judge))
    rows = [kinds.repeat("nasty", "six angles", seed) for seed in (0, 3)]
    assert drawn == [0, 3]
    assert [row.case for row in rows] == ["six angles", "six angles, seed 3"]
    assert rows[1].command.endswith("--case 'six angles' --seed 3")


def test_a_campaign_needs_a_folder_and_a_kind(
    instrument: Callable[..., Result], tmp_path: Path
) -> None:
    answer = instrument("faults", "--kind", "nasty")
    assert (answer.exit_code, "--out" in answer.output) == (2, True)
    answer = instrument("faults", "--kind", "floods", "--out", tmp_path)
    assert (answer.exit_code, "schema" in answer.output) == (2, True)


def test_a_campaign_shows_what_was_beyond(
    instrument: Callable[..., Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def judge(case: object, blank: Row) -> Row:
        return replace(blank, command="python -m bench …", beyond=("table hit",))

    monkeypatch.setitem(kinds.KINDS, "nasty", replace(kinds.KINDS["nasty"], work=judge))
    answer = instrument("faults", "--kind", "nasty", "--out", tmp_path, "--workers", 1)
    assert answer.exit_code == 0
    assert "python -m bench …: table hit" in answer.output
    assert (tmp_path / "campaign.html").exists()
