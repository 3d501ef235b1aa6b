import json
from typing import Any

import pytest

from palpate.common.errors import InputError
from palpate.planning.model.answer import read_answer
from palpate.planning.model.normal import flat_schema, nest_tree
from palpate.primitives.registry import vocabulary


def test_the_schema_is_strict_and_without_recursion() -> None:
    def visit(schema: Any) -> None:
        if isinstance(schema, dict):
            assert "$ref" not in schema
            if schema.get("type") == "object":
                assert set(schema["required"]) == set(schema["properties"])
                assert schema["additionalProperties"] is False
            for value in schema.values():
                visit(value)
        elif isinstance(schema, list):
            for value in schema:
                visit(value)

    visit(flat_schema(vocabulary(), with_scene=True))


def test_the_schema_has_every_primitive_argument_and_allows_null() -> None:
    words = vocabulary()
    node = flat_schema(words, with_scene=False)["properties"]["nodes"]["items"]["properties"]
    assert set(node["type"]["enum"]) == {*words.primitives, *words.composites}
    arguments = {name for p in words.primitives.values() for name in p.model_fields}
    assert set(node) == arguments | {"id", "type", "children"}
    assert all({"type": "null"} in node[name]["anyOf"] for name in arguments)
    assert {"type": "string", "enum": ["+x", "-x", "+y", "-y", "+z", "-z"]} in node["axis"]["anyOf"]


def test_the_schema_has_detected_objects_only_without_a_scene() -> None:
    assert "scene" in flat_schema(vocabulary(), with_scene=True)["properties"]
    assert "scene" not in flat_schema(vocabulary(), with_scene=False)["properties"]


FLAT = {
    "parameters": [],
    "explanation": "e",
    "nodes": [
        {"id": 0, "type": "Sequence", "children": [1, 2], "pose": None},
        {"id": 1, "type": "OpenGripper", "children": [], "pose": None},
        {"id": 2, "type": "Parallel", "children": [3], "pose": None},
        {"id": 3, "type": "MovePose", "children": [], "pose": "cup_pose"},
    ],
}


def test_a_flat_list_of_nodes_is_the_tree_it_describes() -> None:
    tree = read_answer(json.dumps(FLAT)).plan.tree
    assert tree is not None
    assert [(path, node.type, node.args) for path, node in tree.walk()] == [
        ("tree", "Sequence", ()),
        ("tree.children[0]", "OpenGripper", ()),
        ("tree.children[1]", "Parallel", ()),
        ("tree.children[1].children[0]", "MovePose", (("pose", "cup_pose"),)),
    ]


def test_an_empty_flat_list_is_no_tree() -> None:
    assert read_answer(json.dumps(FLAT | {"nodes": []})).plan.tree is None


@pytest.mark.parametrize(
    "nodes",
    [
        "many",
        [{"type": "OpenGripper"}],
        [{"id": 0, "type": "A", "children": [0]}],
        [{"id": 0, "type": "A", "children": [7]}],
        [{"id": 0, "type": "A", "children": [[1]]}],
        [{"id": 0, "type": "A"}, {"id": 0, "type": "B"}],
        [{"id": 0, "type": "A"}, {"id": 1, "type": "B"}],
        [
            {"id": 0, "type": "A"},
            {"id": 1, "type": "B", "children": [2]},
            {"id": 2, "type": "C", "children": [1]},
        ],
        [{"id": 0, "type": "A", "children": [1, 1]}, {"id": 1, "type": "B"}],
        [{"id": i, "type": "A", "children": [i + 1]} for i in range(5000)]
        + [{"id": 5000, "type": "B"}],
    ],
)
def test_a_flat_list_that_is_no_tree_is_refused(nodes: object) -> None:
    with pytest.raises(InputError, match="nodes"):
        nest_tree({"parameters": [], "nodes": nodes})
