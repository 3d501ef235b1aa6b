"""Deformed answers with one possible meaning are read at once."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest

from palpate.common.errors import InputError
from palpate.planning.model.answer import read_answer

MOVE = {"type": "MovePose", "pose": "cup_pose"}
TREE = {"type": "Sequence", "children": [{"type": "OpenGripper"}, MOVE]}
PLAN = {
    "parameters": [{"object": "cup", "quantity": "mass"}],
    "explanation": "Weigh the cup.",
    "tree": TREE,
}


def plan(**changes: Any) -> str:
    return json.dumps({**{k: v for k, v in PLAN.items() if k not in changes}, **changes})


def flat(*nodes: dict[str, Any]) -> str:
    fields = {key: value for key, value in PLAN.items() if key != "tree"}
    return json.dumps({**fields, "nodes": list(nodes)})


def without(name: str) -> dict[str, Any]:
    return {key: value for key, value in PLAN.items() if key != name}


ANSWERS: dict[str, str] = {
    "type as key": plan(
        tree={"sequence": [{"OpenGripper": {}}, {"MovePose": {"pose": "cup_pose"}}]}
    ),
    "value of the key": plan(tree={"Sequence": [{"OpenGripper": None}, {"MovePose": "cup_pose"}]}),
    "calls": plan(tree={"sequence": ["OpenGripper()", "MovePose(pose='cup_pose')"]}),
    "positional call": plan(tree={"sequence": ["OpenGripper", 'MovePose("cup_pose")']}),
    "kind": plan(tree={"kind": "Sequence", "children": [{"kind": "OpenGripper"}, MOVE]}),
    "name": plan(tree={"name": "Sequence", "children": [{"name": "OpenGripper"}, MOVE]}),
    "attributes": plan(
        tree=[{"type": "OpenGripper"}, {"type": "MovePose", "attributes": {"pose": "cup_pose"}}]
    ),
    "list of arguments": plan(
        tree=[{"type": "OpenGripper"}, {"type": "MovePose", "args": ["cup_pose"]}]
    ),
    "texts as ids": flat(
        {"id": "root", "type": "Sequence", "children": ["open", "move"]},
        {"id": "open", "type": "OpenGripper"},
        {"id": "move", **MOVE},
    ),
    "parents": flat(
        {"id": 0, "type": "Sequence", "parent": None},
        {"id": 1, "type": "OpenGripper", "parent": 0},
        {"id": 2, "parent": 0, **MOVE},
    ),
    "behaviorTree": json.dumps({**without("tree"), "behaviorTree": TREE}),
    "Φ": json.dumps({**without("parameters"), "Φ": PLAN["parameters"]}),
    "name of a parameter": plan(parameters=[{"name": "cup.mass"}]),
    "body and parameter": plan(parameters=[{"body": "cup", "parameter": "Mass"}]),
    "keys without quotes": plan().replace('"type":', "type:"),
}


@pytest.mark.parametrize("kind", ANSWERS)
def test_a_deformed_answer_is_read(kind: str):
    assert read_answer(ANSWERS[kind]).plan == read_answer(plan()).plan


@pytest.mark.parametrize(
    ("deform", "message"),
    [
        (lambda: plan(tree={"Frobnicate": []}), 'a node is {"type": "MovePose"'),
        (
            lambda: plan(tree={"Sequence": [{"MovePose": {"pose": "a"}, "OpenGripper": {}}]}),
            "'type'",
        ),
        (lambda: plan()[:-3], "breaks off"),
        (lambda: json.dumps(without("parameters")), "'parameters'"),
    ],
)
def test_an_ambiguous_answer_is_refused_with_the_form(deform: Callable[[], str], message: str):
    with pytest.raises(InputError) as refusal:
        read_answer(deform())
    assert message in str(refusal.value)
