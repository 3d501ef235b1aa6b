"""The JSON schema accepts what `parse_plan` and the check's grammar accept, and refuses what they
refuse."""

from __future__ import annotations

import json
import re
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from palpate.common.errors import InputError
from palpate.planning.check.check import check
from palpate.planning.plan import parse_plan
from palpate.primitives.registry import leaf_schema, plan_schema, vocabulary

SCHEMA = plan_schema(vocabulary())


def fits(plan: Any) -> bool:
    """True if a plan matches the schema."""
    return Draft202012Validator(SCHEMA).is_valid(plan)


def is_accepted(tree: Any) -> bool:
    """By the parser, and by the grammar that is checked without a scene."""
    try:
        plan = parse_plan(json.dumps(document(tree)))
    except InputError:
        return False
    grammar = ("unknown-primitive", "bad-argument", "leaf-children", "empty-composite")
    return not [finding for finding in check(plan, None) if finding.rule in grammar]


def document(tree: Any) -> dict[str, Any]:
    return {
        "parameters": [{"object": "cup", "quantity": "mass"}],
        "explanation": "why",
        "tree": tree,
    }


OPEN = {"type": "OpenGripper"}
GOOD = [
    None,
    OPEN,
    {"type": "OpenGripper", "name": "let go"},
    {"type": "MovePose", "pose": "cup_pose + z_offset"},
    {"type": "MovePose", "pose": "p" * 200},
    {"type": "MoveJoints", "joints": "home_config"},
    {"type": "MoveJoints", "joints": [0, -0.785, 0, -2.356, 0, 1.571, 0.785]},
    *({"type": "MoveUntilContact", "axis": sign + axis} for sign in "+-" for axis in "xyz"),
    *(
        {"type": name}
        for name in (
            "CloseGripper",
            "MeasureForces",
            "MeasureGripperPose",
            "Force2Mass",
            "Pose2Plan",
        )
    ),
    {"type": "Sequence", "children": [OPEN]},
    {
        "type": "Parallel",
        "name": "both",
        "children": [{"type": "MeasureForces"}, {"type": "MovePose", "pose": "a"}],
    },
    {
        "type": "Sequence",
        "children": [{"type": "Parallel", "children": [{"type": "Sequence", "children": [OPEN]}]}],
    },
]
BAD = [
    [],
    "OpenGripper",
    {},
    {"type": "WeighObject"},
    {"type": "OpenGripper", "width": 0.04},
    {"type": "OpenGripper", "children": [OPEN]},
    {"type": "OpenGripper", "name": 3},
    {"type": "MovePose"},
    {"type": "MovePose", "pose": ""},
    {"type": "MovePose", "pose": "p" * 201},
    {"type": "MovePose", "pose": ["cup_pose"]},
    {"type": "MoveJoints", "joints": {"name": "home_config"}},
    {"type": "MoveJoints", "joints": ["a"]},
    {"type": "MoveUntilContact", "axis": "z"},
    {"type": "MoveUntilContact"},
    {"type": "Sequence"},
    {"type": "Sequence", "children": []},
    {"type": "Sequence", "children": [OPEN], "memory": True},
    {"type": "Sequence", "children": OPEN},
    {"type": "Sequence", "children": [{"type": "Parallel", "children": []}]},
]


@pytest.mark.parametrize("tree", GOOD, ids=str)
def test_schema_accepts_plans_that_the_check_accepts(tree: Any) -> None:
    assert fits(document(tree))
    assert tree is None or is_accepted(tree)


@pytest.mark.parametrize("tree", BAD, ids=str)
def test_schema_refuses_plans_that_the_check_refuses(tree: Any) -> None:
    assert not fits(document(tree))
    assert not is_accepted(tree)


@pytest.mark.parametrize("field", ["parameters", "tree"])
def test_plan_schema_requires_parameters_explanation_and_tree(field: str) -> None:
    plan = document(OPEN)
    del plan[field]
    assert not fits(plan)
    with pytest.raises(InputError, match=field):
        parse_plan(json.dumps(plan))


def test_every_reference_leads_somewhere() -> None:
    references = set(re.findall(r'"\$ref": "#/\$defs/(\w+)"', json.dumps(SCHEMA)))
    assert references == {*vocabulary().primitives, *vocabulary().composites, "node"}
    assert references == set(SCHEMA["$defs"])


def test_a_leafs_schema_is_its_declaration() -> None:
    schema = leaf_schema(vocabulary().primitive("MoveUntilContact"))
    assert schema["properties"]["axis"]["enum"] == ["+x", "-x", "+y", "-y", "+z", "-z"]
    assert schema["properties"]["axis"]["description"] == "direction of motion, world axes"
    assert schema["description"].startswith("Move slowly and compliantly along one axis")
    assert schema["required"] == ["type", "axis"]
