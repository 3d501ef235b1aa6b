"""The JSON schema accepts what `parse_plan` and the check's grammar accept, and refuses what they
refuse."""

from __future__ import annotations

import json
import re
from typing import Any

import pytest

from palpate.errors import InputError
from palpate.planning.check.check import check
from palpate.planning.plan import parse_plan
from palpate.vocabulary.registry import vocabulary
from palpate.vocabulary.schema import leaf_schema, plan_schema

SCHEMA = plan_schema(vocabulary())
KINDS: dict[str, Any] = {
    "object": dict,
    "array": list,
    "string": str,
    "number": (int, float),
    "null": type(None),
}


def fits(value: Any, schema: dict[str, Any]) -> bool:
    """JSON schema, as much of it as a plan's schema uses."""
    schema = SCHEMA["$defs"][schema["$ref"].rpartition("/")[2]] if "$ref" in schema else schema
    known = {
        "type",
        "const",
        "enum",
        "anyOf",
        "oneOf",
        "properties",
        "required",
        "additionalProperties",
        "items",
        "minItems",
        "minLength",
        "maxLength",
        "title",
        "description",
        "$schema",
        "$defs",
        "default",
    }
    assert set(schema) <= known, f"this validator does not know {set(schema) - known}"
    choices = [fits(value, option) for option in schema.get("oneOf", [])]
    return all(
        (
            "type" not in schema
            or (isinstance(value, KINDS[schema["type"]]) and not isinstance(value, bool)),
            "const" not in schema or value == schema["const"],
            "enum" not in schema or value in schema["enum"],
            "anyOf" not in schema or any(fits(value, option) for option in schema["anyOf"]),
            not choices or choices.count(True) == 1,
            not isinstance(value, str)
            or schema.get("minLength", 0) <= len(value) <= schema.get("maxLength", 10**9),
            not isinstance(value, list)
            or (
                len(value) >= schema.get("minItems", 0)
                and all(fits(item, schema.get("items", {})) for item in value)
            ),
            not isinstance(value, dict) or _fields_fit(value, schema),
        )
    )


def _fields_fit(value: dict[str, Any], schema: dict[str, Any]) -> bool:
    properties = schema.get("properties", {})
    closed = schema.get("additionalProperties", True) is False
    return (
        set(schema.get("required", [])) <= set(value)
        and not (closed and set(value) - set(properties))
        and all(fits(v, properties[k]) for k, v in value.items() if k in properties)
    )


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
def test_accepts_what_the_check_accepts(tree: Any) -> None:
    assert fits(document(tree), SCHEMA)
    assert tree is None or is_accepted(tree)


@pytest.mark.parametrize("tree", BAD, ids=str)
def test_refuses_what_the_check_refuses(tree: Any) -> None:
    assert not fits(document(tree), SCHEMA)
    assert not is_accepted(tree)


@pytest.mark.parametrize("field", ["parameters", "tree"])
def test_what_a_plan_needs(field: str) -> None:
    plan = document(OPEN)
    del plan[field]
    assert not fits(plan, SCHEMA)
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
