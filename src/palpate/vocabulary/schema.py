"""The JSON schema of a plan, derived from the vocabulary's declarations."""

from __future__ import annotations

from typing import Any

from palpate.vocabulary.base import Primitive
from palpate.vocabulary.composites import Composite
from palpate.vocabulary.registry import Vocabulary


def leaf_schema(cls: type[Primitive]) -> dict[str, Any]:
    """Schema of one primitive's node."""
    schema = cls.model_json_schema()
    properties: dict[str, Any] = {"type": {"const": cls.__name__}, "name": {"type": "string"}}
    buffer = cls.reads or cls.writes
    if buffer:
        properties[buffer] = {
            "const": buffer,
            "description": "the buffer, which may be named as the paper names it",
        }
    properties |= schema.get("properties", {})
    return {
        "type": "object",
        "description": cls.summary(),
        "properties": properties,
        "required": ["type", *schema.get("required", [])],
        "additionalProperties": False,
    }


def _composite_schema(composite: Composite) -> dict[str, Any]:
    return {
        "type": "object",
        "description": composite.summary,
        "required": ["type", "children"],
        "properties": {
            "type": {"const": composite.name},
            "name": {"type": "string"},
            "children": {"type": "array", "minItems": 1, "items": {"$ref": "#/$defs/node"}},
        },
        "additionalProperties": False,
    }


def plan_schema(vocabulary: Vocabulary) -> dict[str, Any]:
    """JSON schema (2020-12) of a whole plan; the tree is recursive through `$defs/node`."""
    leaves = {name: leaf_schema(cls) for name, cls in vocabulary.primitives.items()}
    composites = {name: _composite_schema(c) for name, c in vocabulary.composites.items()}
    node = {"oneOf": [{"$ref": f"#/$defs/{name}"} for name in (*leaves, *composites)]}
    parameter = {
        "type": "object",
        "required": ["object", "quantity"],
        "additionalProperties": False,
        "properties": {"object": {"type": "string"}, "quantity": {"type": "string"}},
    }
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "palpate plan",
        "type": "object",
        "required": ["parameters", "explanation", "tree"],
        "properties": {
            "parameters": {"type": "array", "items": parameter},
            "explanation": {"type": "string"},
            "tree": {"oneOf": [{"type": "null"}, {"$ref": "#/$defs/node"}]},
        },
        "$defs": {**leaves, **composites, "node": node},
    }
