"""The plan as a JSON schema without recursion, for providers' native structured output.

Recursive schemas are not accepted everywhere; a list of nodes that name their children is.
`palpate.planning.extract.nested` makes the tree of it.
"""

from __future__ import annotations

from typing import Any

from palpate.vocabulary.registry import Vocabulary

NOTE = (
    "This channel takes the tree in flat form: instead of `tree`, give `nodes`, a list of all nodes, the root "
    "first, each with a whole number `id`, its `type`, the ids of its `children`, and null for every argument "
    'that its type does not have. An empty list stands for `"tree": null`.'
)
"""Goes into the user message, so that the system prompt stays the same."""


def flat_schema(vocabulary: Vocabulary, with_scene: bool) -> dict[str, Any]:
    """JSON schema of an answer: strict (all fields required), no references, no recursion."""
    properties: dict[str, Any] = {
        "parameters": {
            "type": "array",
            "items": _object({"object": {"type": "string"}, "quantity": {"type": "string"}}),
        },
        "explanation": {"type": "string"},
        "nodes": {"type": "array", "items": _object(_node_properties(vocabulary))},
    }
    if with_scene:
        properties["scene"] = {
            "type": "array",
            "items": _object(
                {
                    "name": {"type": "string"},
                    "shape": {"type": "string", "enum": ["box", "cylinder", "sphere", "plane"]},
                    "bbox": {"type": "array", "items": {"type": "number"}},
                    "height": {"anyOf": [{"type": "number"}, {"type": "null"}]},
                }
            ),
        }
    return _object(properties)


def _node_properties(vocabulary: Vocabulary) -> dict[str, Any]:
    types = [*vocabulary.primitives, *vocabulary.composites]
    properties: dict[str, Any] = {
        "id": {"type": "integer"},
        "type": {"type": "string", "enum": types},
        "children": {"type": "array", "items": {"type": "integer"}},
    }
    arguments: dict[str, list[dict[str, Any]]] = {}
    for primitive in vocabulary.primitives.values():
        for name, schema in primitive.model_json_schema().get("properties", {}).items():
            arguments.setdefault(name, []).extend(_plain(schema))
    return properties | {
        name: {"anyOf": [*_distinct(forms), {"type": "null"}]} for name, forms in arguments.items()
    }


def _plain(schema: dict[str, Any]) -> list[dict[str, Any]]:
    """The schema's alternatives with only the keywords that every provider takes."""
    kept = ("type", "enum", "items")
    return [{k: v for k, v in form.items() if k in kept} for form in schema.get("anyOf", [schema])]


def _distinct(forms: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [
        form
        for i, form in enumerate(forms)
        if form and form not in forms[:i] and form != {"type": "null"}
    ]


def _object(properties: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }
