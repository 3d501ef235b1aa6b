"""Flat form of a plan, for providers' native structured output: its JSON schema, and its reading.

Recursive schemas are not accepted everywhere; a list of nodes that name their children is.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

from palpate.errors import InputError
from palpate.planning.plan import MAX_NESTING, OUTCOMES
from palpate.vocabulary.registry import Vocabulary

Schema = dict[str, Any]
"""A JSON schema, or the properties of one."""

_TEXT: Schema = {"type": "string"}
_INTEGER: Schema = {"type": "integer"}
_NUMBER: Schema = {"type": "number"}
_NULL: Schema = {"type": "null"}
_AGAIN: Schema = {"anyOf": [{"type": "boolean"}, _NULL]}
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
    node: Schema = {
        "id": _INTEGER,
        "type": {"type": "string", "enum": [*vocabulary.primitives, *vocabulary.composites]},
        "children": _list_of(_INTEGER),
    }
    # One node type for all primitives: each argument may be null where a type lacks it.
    for name, forms in argument_forms(vocabulary).items():
        node[name] = {"anyOf": [*forms, _NULL]}
    properties = {
        "outcome": {"type": "string", "enum": list(OUTCOMES)},
        "parameters": _list_of(_object({"object": _TEXT, "quantity": _TEXT, "again": _AGAIN})),
        "explanation": _TEXT,
        "nodes": _list_of(_object(node)),
    }
    if with_scene:
        properties["scene"] = _list_of(_object(_SCENE_OBJECT))
    return _object(properties)


def argument_forms(vocabulary: Vocabulary) -> dict[str, list[Schema]]:
    """The different forms of each argument over all primitives that have it, null left out."""
    arguments: dict[str, list[Schema]] = {}
    for primitive in vocabulary.primitives.values():
        for name, schema in primitive.model_json_schema().get("properties", {}).items():
            forms = arguments.setdefault(name, [])
            for form in schema.get("anyOf", [schema]):
                # Only keywords that every provider accepts.
                kept = {k: form[k] for k in form if k in ("type", "enum", "items")}
                if kept and kept != _NULL and kept not in forms:
                    forms.append(kept)
    return arguments


def _list_of(items: Schema) -> Schema:
    return {"type": "array", "items": items}


def _object(properties: Schema) -> Schema:
    return {
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }


def nested(document: Mapping[str, Any]) -> dict[str, Any]:
    """A plan document with its tree nested, from one with a list of `nodes` whose children are ids.

    Null arguments, which strict schemas demand, are dropped. An empty list is no tree.

    Raises:
        InputError: an id is unknown or used twice, or the nodes do not form one tree.
    """
    plan = dict(document)
    nodes = nodes_by_id(plan.pop("nodes"))
    if not nodes:
        return {**plan, "tree": None}
    below = [child for node in nodes.values() for child in children_of(node)]
    roots = nodes.keys() - set(below)
    if len(roots) != 1 or len(below) != len(set(below)):
        raise InputError(
            "nodes: every node but one, the root, must be the child of exactly one other"
        )
    # A ring apart from the root has one parent each, too; its nodes are never visited.
    used: list[int] = []
    tree = grown(roots.pop(), nodes, used)
    if len(used) != len(nodes):
        raise InputError("nodes: some are not below the root; every node must be")
    return {**plan, "tree": tree}


def nodes_by_id(value: object) -> dict[int, dict[str, Any]]:
    """The nodes by id.

    Raises:
        InputError: not a list, an id is missing or used twice, or a child is missing.
    """
    if not isinstance(value, list):
        raise InputError("nodes: must be a list")
    nodes: dict[int, dict[str, Any]] = {}
    for i, item in enumerate(cast("list[object]", value)):
        node = cast("dict[str, Any]", item) if isinstance(item, dict) else {}
        id = node.get("id")
        if not isinstance(id, int) or id in nodes:
            raise InputError(f"nodes[{i}]: needs an 'id' of its own, a whole number")
        nodes[id] = node
    for id, node in nodes.items():
        for child in children_of(node):
            if not isinstance(child, int) or child not in nodes:
                raise InputError(
                    f"nodes: node {id} has the child {str(child)[:40]}, which is not there"
                )
    return nodes


def children_of(node: Mapping[str, Any]) -> list[Any]:
    """The ids of a node's children; one may be written without a list."""
    children: object = node.get("children") or []
    return cast("list[Any]", children) if isinstance(children, list) else [children]


def grown(
    id: int, nodes: Mapping[int, Mapping[str, Any]], used: list[int], depth: int = 0
) -> dict[str, Any]:
    """The node with all nodes below it; their ids are appended to `used`."""
    if depth > MAX_NESTING:
        raise InputError("nodes: the tree is nested too deep; flatten it")
    used.append(id)
    node: dict[str, Any] = {}
    for key, value in nodes[id].items():
        if value is not None and key not in ("id", "children"):
            node[key] = value
    children = [grown(child, nodes, used, depth + 1) for child in children_of(nodes[id])]
    if children:
        node["children"] = children
    return node
