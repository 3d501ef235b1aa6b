"""Recorded plans and conversations as planners."""

from __future__ import annotations

from pathlib import Path

import pytest
from workbench import BOTTLE, bench, plan, sequence, weigh

from palpate.common.errors import InputError
from palpate.planning.model.conversation import Answer, Conversation, Round
from palpate.planning.plan import dump_plan
from palpate.planning.registry import ReplayPlanner, load_proposal, plan_file

WEIGHED = plan(sequence(*weigh("bottle")), "bottle.mass")


def test_a_plan_file_and_a_run_folder_are_replayed(tmp_path: Path):
    file = tmp_path / "plan.json"
    file.write_text(dump_plan(WEIGHED, {"model": {"rounds": 1}}), encoding="utf-8")
    assert load_proposal(file).plan == load_proposal(tmp_path).plan == WEIGHED
    assert plan_file(tmp_path) == file
    replayed = ReplayPlanner(file).plan("whatever", bench(BOTTLE))
    assert (replayed.tree, replayed.parameters, replayed.planner) == (
        WEIGHED.tree,
        WEIGHED.parameters,
        "replay",
    )


def test_a_conversation_is_replayed_up_to_its_first_valid_plan(tmp_path: Path):
    refused = Round("the request", Answer("I am not sure."), ("no JSON",))
    valid = Round("the check refused", Answer(f"Here:\n```json\n{dump_plan(WEIGHED)}```"))
    file = tmp_path / "conversation.json"
    file.write_text(Conversation("openai:m", "S", rounds=[refused, valid]).dump(), encoding="utf-8")
    assert ReplayPlanner(file).plan(None, bench(BOTTLE)).tree == WEIGHED.tree


def test_a_missing_file_or_one_without_a_plan_is_bad_input(tmp_path: Path):
    with pytest.raises(InputError, match="no plan file"):
        load_proposal(tmp_path / "none.json")
    with pytest.raises(InputError, match=r"no plan\.json"):
        load_proposal(tmp_path)
    (tmp_path / "plan.json").write_text("hello", encoding="utf-8")
    with pytest.raises(InputError, match="not JSON"):
        load_proposal(tmp_path)
