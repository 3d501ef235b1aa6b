"""The plan as a JSON schema without recursion, for providers' native structured output.

Recursive schemas are not accepted everywhere; a list of nodes that name their children is.
`palpate.planning.model.answer.nested` makes the tree of it.
"""

from __future__ import annotations

from typing import Any

from palpate.planning.plan import OUTCOMES
from palpate.vocabulary.registry import Vocabulary

Schema = dict[str, Any]
"""A JSON schema, or the properties of one."""

_TEXT: Schema = {"type": "string"}
_INTEGER: Schema = {"type": "integer"}
_NUMBER: Schema = {"type": "number"}
_NULL: Schema = {"type": "null"}
_SCENE_OBJECT: Schema = {
    "name": _TEXT,
    "shape": {"type": "string", "enum": ["box", "cylinder", "sphere", "plane"]},
    "bbox": {"type": "array", "items": _NUMBER},
    "height": {"anyOf": [_NUMBER, _NULL]},
}

NOTE = (
    "This channel takes the tree in flat form: instead of `tree`, give `nodes`, a list of all nodes, the root "
    "first, each with a whole number `id`, its `type`, the ids of its `children`, and null for every argument "
    'that its type does not have. An empty list stands for `"tree": null`.'
)
"""Goes into the user message, so that the system prompt stays the same."""


def flat_schema(vocabulary: Vocabulary, with_scene: bool) -> Schema:
    """JSON schema of an answer: strict (all fields required), no references, no recursion."""
    properties = {
        "outcome": {"type": "string", "enum": list(OUTCOMES)},
        "parameters": _list_of(_object({"object": _TEXT, "quantity": _TEXT})),
        "explanation": _TEXT,
        "nodes": _list_of(_object(_node_properties(vocabulary))),
    }
    if with_scene:
        properties["scene"] = _list_of(_object(_SCENE_OBJECT))
    return _object(properties)


def _node_properties(vocabulary: Vocabulary) -> Schema:
    types = [*vocabulary.primitives, *vocabulary.composites]
    properties: Schema = {
        "id": _INTEGER,
        "type": {"type": "string", "enum": types},
        "children": _list_of(_INTEGER),
    }
    for name, forms in _arguments(vocabulary).items():
        properties[name] = {"anyOf": [*_distinct(forms), _NULL]}
    return properties


def _arguments(vocabulary: Vocabulary) -> dict[str, list[Schema]]:
    """The forms that each argument takes in any primitive that has it."""
    arguments: dict[str, list[Schema]] = {}
    for primitive in vocabulary.primitives.values():
        for name, schema in primitive.model_json_schema().get("properties", {}).items():
            arguments.setdefault(name, []).extend(_plain(schema))
    return arguments


def _plain(schema: Schema) -> list[Schema]:
    """The schema's alternatives with only the keywords that every provider takes."""
    alternatives: list[Schema] = []
    for form in schema.get("anyOf", [schema]):
        kept = form.keys() & {"type", "enum", "items"}
        alternatives.append({key: value for key, value in form.items() if key in kept})
    return alternatives


def _distinct(forms: list[Schema]) -> list[Schema]:
    """Each form once, without those that say nothing or null."""
    distinct: list[Schema] = []
    for form in forms:
        if form and form != _NULL and form not in distinct:
            distinct.append(form)
    return distinct


def _list_of(items: Schema) -> Schema:
    return {"type": "array", "items": items}


def _object(properties: Schema) -> Schema:
    return {
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }
