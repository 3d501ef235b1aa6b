"""Recorded plans and conversations as planners."""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from workbench import BOTTLE, bench, plan, sequence, weigh

from palpate.common.errors import InputError
from palpate.planning.btcpp import tree_xml
from palpate.planning.check.check import check
from palpate.planning.model.conversation import Answer, Conversation, Round
from palpate.planning.plan import Plan, dump_plan
from palpate.planning.registry import (
    ReplayPlanner,
    complete_parameters,
    load_proposal,
    plan_file,
    read_proposal,
)
from palpate.primitives.registry import vocabulary
from palpate.runs import pipeline
from palpate.studies.scenarios.catalogue import scenario

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


def test_a_file_that_is_not_utf8_is_bad_input(tmp_path: Path):
    (tmp_path / "plan.json").write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match=r"not UTF-8 text \(byte 0\)"):
        load_proposal(tmp_path)


@given(st.binary() | st.text().map(str.encode))
@settings(max_examples=100, deadline=None)
def test_any_file_is_a_plan_or_an_input_error(content: bytes):
    with suppress(InputError):
        read_proposal(content)


@pytest.mark.parametrize(
    ("reply", "said"),
    [
        (
            '{"error": {"message": "Rate limit\\nreached", "code": 429}}',
            "error: Rate limit reached",
        ),
        ('{"type": "error", "error": {"type": "overloaded_error"}}', "overloaded_error"),
        ('data: {"error": {"message": "no such model"}}', "error: no such model"),
        ("data: 5", "not JSON"),
        ('{"parameters": [], "error": null}', "needs the field 'tree'"),
    ],
)
def test_an_error_of_a_server_is_told_in_its_words(reply: str, said: str):
    with pytest.raises(InputError, match=said):
        read_proposal(reply.encode())


def test_a_saved_stream_is_read():
    text = dump_plan(WEIGHED)
    parts = (text[: len(text) // 2], text[len(text) // 2 :])
    events = [json.dumps({"choices": [{"index": 0, "delta": {"content": part}}]}) for part in parts]
    stream = "".join(f"data: {event}\n\n" for event in [*events, "[DONE]"])
    assert read_proposal(stream.encode()).plan == WEIGHED


# A behavior tree in XML, with and without the metadata of the plan.


def bare_tree(plan: Plan) -> bytes:
    """The plan as XML without its model and metadata, as a person writes it."""
    text = tree_xml(plan, vocabulary())
    return (text[: text.index("<TreeNodesModel>")] + "</root>").encode()


def test_the_tree_of_a_run_is_replayed(tmp_path: Path):
    file = tmp_path / "tree.xml"
    file.write_text(tree_xml(replace(WEIGHED, planner="symbolic"), vocabulary()), encoding="utf-8")
    replayed = ReplayPlanner(file).plan("whatever", bench(BOTTLE))
    assert replayed == replace(WEIGHED, planner="symbolic")
    assert not check(replayed, bench(BOTTLE))


def test_a_bare_tree_measures_its_conversions(tmp_path: Path):
    file = tmp_path / "tree.xml"
    file.write_bytes(bare_tree(WEIGHED))
    replayed = ReplayPlanner(file).plan(None, bench(BOTTLE))
    assert (replayed.tree, replayed.parameters) == (WEIGHED.tree, WEIGHED.parameters)
    assert replayed.notes == ("the parameters follow from the tree: bottle.mass",)
    assert not check(replayed, bench(BOTTLE))


def test_a_bare_tree_measures_derived_quantities():
    task = scenario("friction")
    scene = pipeline.load(task.settings().check_values())
    stated = load_proposal(task.folder / "plans" / "model.json").plan
    found = complete_parameters(read_proposal(bare_tree(stated)), scene)
    assert set(found.parameters) == set(stated.parameters)
    assert not check(found, scene)


def test_a_bare_tree_without_a_measurement_asks_for_its_parameters():
    proposal = read_proposal(bare_tree(plan(sequence(*weigh("bottle")[:2]))))
    with pytest.raises(InputError, match=r'"parameters": \["OBJECT.QUANTITY"\]'):
        complete_parameters(proposal, bench(BOTTLE))
    assert complete_parameters(proposal, None).parameters == ()


def test_a_fault_of_a_bare_tree_is_a_finding():
    text = bare_tree(WEIGHED).replace(b"bottle_pose", b"botle_pose")
    found = complete_parameters(read_proposal(text), bench(BOTTLE))
    assert "unknown-symbol" in {finding.rule for finding in check(found, bench(BOTTLE))}
