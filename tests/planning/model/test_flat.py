from typing import Any

from palpate.planning.model.flat import flat_schema
from palpate.vocabulary.registry import vocabulary


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


def test_every_primitive_argument_is_in_it_and_may_be_null() -> None:
    words = vocabulary()
    node = flat_schema(words, with_scene=False)["properties"]["nodes"]["items"]["properties"]
    assert set(node["type"]["enum"]) == {*words.primitives, *words.composites}
    arguments = {name for p in words.primitives.values() for name in p.model_fields}
    assert set(node) == arguments | {"id", "type", "children"}
    assert all({"type": "null"} in node[name]["anyOf"] for name in arguments)
    assert {"type": "string", "enum": ["+x", "-x", "+y", "-y", "+z", "-z"]} in node["axis"]["anyOf"]


def test_the_scene_is_asked_for_only_without_d() -> None:
    assert "scene" in flat_schema(vocabulary(), with_scene=True)["properties"]
    assert "scene" not in flat_schema(vocabulary(), with_scene=False)["properties"]
