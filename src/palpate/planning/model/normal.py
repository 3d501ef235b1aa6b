"""Normal form of a plan's document, and its flat form for structured output."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, cast

from palpate.common.errors import InputError
from palpate.estimation.quantities.catalogue import catalogue
from palpate.planning.plan import MAX_NESTING, OUTCOMES, nesting, unique_json
from palpate.primitives.registry import Vocabulary, vocabulary

Schema = dict[str, Any]
"""JSON schema, or the properties of one."""

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
"""Part of the user message, so that the system prompt is the same for all forms."""


def flat_schema(vocabulary: Vocabulary, with_scene: bool) -> Schema:
    """Return the JSON schema of an answer. It is strict (all fields required), without references and recursion."""
    node: Schema = {
        "id": _INTEGER,
        "type": {"type": "string", "enum": [*vocabulary.primitives, *vocabulary.composites]},
        "children": _list_of(_INTEGER),
    }
    # One node type serves all primitives, so an argument is null for types without it.
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
    """Return the different schemas of each argument over all primitives, without null."""
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


def nest_tree(document: Mapping[str, Any]) -> dict[str, Any]:
    """Convert a plan with a flat list of `nodes` to one with a nested tree.

    Null arguments, which strict schemas require, are dropped. An empty list means no tree.
    Raises InputError: an id is unknown or duplicate, or the nodes do not form one tree.
    """
    plan = dict(document)
    nodes = nodes_by_id(plan.pop("nodes"))
    if not nodes:
        return {**plan, "tree": None}
    # A tree has one root and exactly one parent for every other node.
    below = [child for node in nodes.values() for child in children_of(node)]
    roots = nodes.keys() - set(below)
    if len(roots) != 1 or len(below) != len(set(below)):
        raise InputError(
            "nodes: every node but one, the root, must be the child of exactly one other"
        )
    # Nodes of a separate cycle also have one parent each, but are never visited.
    used: list[int] = []
    tree = grown(roots.pop(), nodes, used)
    if len(used) != len(nodes):
        raise InputError("nodes: some are not below the root; every node must be")
    return {**plan, "tree": tree}


def nodes_by_id(value: object) -> dict[int, dict[str, Any]]:
    """Return the nodes by id. Raises InputError: not a list, an id is missing or duplicate, or a child is missing."""
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
    """Return the ids of a node's children; a single one may be written without a list."""
    children: object = node.get("children") or []
    return cast("list[Any]", children) if isinstance(children, list) else [children]


def grown(
    id: int, nodes: Mapping[int, Mapping[str, Any]], used: list[int], depth: int = 0
) -> dict[str, Any]:
    """Return a node with all nodes below it; appends their ids to `used`."""
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


# Normal form of a plan's document. Names, wrappers and forms with only one possible meaning are
# replaced. Nothing is evaluated. The recursion depth is that of the document, which the caller
# bounds.


MAX_DIGITS = 9
"""Maximum number of digits of an integer written as text."""
TREE = ("root", "behavior_tree", "behaviour_tree", "behaviortree", "behaviourtree", "bt")
"""Synonyms of the field `tree`; `root` may also wrap a plan or a tree."""
PARAMETERS = ("phi", "φ")
"""Synonyms of the field `parameters`."""
OBJECT, QUANTITY = ("body", "obj"), ("parameter", "property")
"""Synonyms of a parameter's `object` and `quantity`."""
TYPE = ("action", "primitive", "node_type", "kind", "class")
"""Synonyms of a node's `type`."""
CHILDREN = ("nodes", "steps")
"""Synonyms of a node's `children`."""
BOXES = ("args", "arguments", "params", "parameters", "attributes", "inputs")
"""Fields that wrap a node's arguments, which belong on the same level as its `type`."""
TOO_DEEP = f"the JSON is nested deeper than {MAX_NESTING} brackets; flatten the tree"

_PLAN_FIELDS = {
    "outcome",
    "parameters",
    "explanation",
    "tree",
    "nodes",
    "scene",
    *TREE,
    *PARAMETERS,
}
_NODE_FIELDS = {"type", "children", "name", "id", *TYPE, *CHILDREN}
_FIELDS = {*_PLAN_FIELDS, *_NODE_FIELDS, "object", "quantity", "again", *OBJECT, *QUANTITY}
"""Field names, which are recognised in any case."""
_ROOTS = ("root", "behaviortree")
"""Types of nodes around a tree, without separators."""


def is_plan(value: object) -> bool:
    """True for an object with a tree; upper and lower case of its name are equal."""
    if not isinstance(value, dict):
        return False
    named = ("tree", "nodes", *TREE)
    return any(key.strip().lower() in named for key in cast("dict[str, Any]", value))


def unwrap_plan(value: object) -> object:
    """Return the plan in an object with a single field; any other value unchanged."""
    if isinstance(value, dict) and len(fields := cast("dict[str, object]", value)) == 1:
        (inner,) = fields.values()
        if is_plan(inner):
            return inner
    return cast("object", value)


def normalize_plan(document: Mapping[str, Any]) -> dict[str, Any]:
    """Normalize the document of a plan.

    The result has lower-case fields, a list of parameters, and one tree with declared types and
    arguments. Instead of a tree it may have a flat list of nodes with integer ids.
    Raises InputError: a tree written as text is nested too deep, or has a duplicate field.
    """
    # Field names first, then parameters, outcome and tree.
    fields = lower_keys(document)
    if "nodes" not in fields:
        rename(fields, "tree", TREE)
    rename(fields, "parameters", PARAMETERS)
    if "parameters" in fields:
        fields["parameters"] = normalize_parameters(fields["parameters"])
    if isinstance(fields.get("outcome"), str):
        fields["outcome"] = fields["outcome"].strip().lower()
    # `nodes` is the flat form, or a synonym of `tree`.
    nodes = fields.get("nodes")
    if isinstance(nodes, list):
        listed = cast("list[object]", nodes)
        if "tree" not in fields and listed and not is_flat(listed):
            fields["tree"] = fields.pop("nodes")
        else:
            fields["nodes"] = assign_ids([normalize_flat_node(node) for node in listed])
    if "tree" in fields:
        fields["tree"] = normalize_tree(from_text(fields["tree"]))
    return fields


def lower_keys(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Rename fields to lower case if the result is a known and unused field name."""
    lowered: dict[str, Any] = {}
    for key, value in fields.items():
        name = key.strip().lower()
        known = name in _FIELDS and (name == key or name not in fields)
        lowered[name if known else key] = value
    return lowered


def rename(fields: dict[str, Any], name: str, others: Sequence[str]) -> None:
    """Rename a synonym to `name`, if it is the only one and `name` is not in use."""
    given = [other for other in others if other in fields]
    if name not in fields and len(given) == 1:
        fields[name] = fields.pop(given[0])


def normalize_parameters(value: object) -> object:
    """Return a list of parameters. An object is one parameter, or a table of quantities by object."""
    if isinstance(value, dict):
        fields = lower_keys(cast("dict[str, Any]", value))
        if "object" in fields or "quantity" in fields:
            value = [fields]
        else:
            value = [
                {"object": object, "quantity": quantity}
                for object, named in fields.items()
                for quantity in cast("list[object]", named if isinstance(named, list) else [named])
            ]
    if not isinstance(value, list):
        return value
    return [normalize_parameter(item) for item in cast("list[object]", value)]


def normalize_parameter(item: object) -> object:
    """Return a parameter as an object; `"cup.mass"` is split and a unit removed."""
    # The short form `object.quantity`, which may be the only field.
    if isinstance(item, dict) and len(fields := cast("dict[str, object]", item)) == 1:
        (alone,) = fields.values()
        item = alone if isinstance(alone, str) and "." in alone else fields
    if isinstance(item, str) and item.count(".") == 1:
        body, quantity = item.split(".")
        item = {"object": body.strip(), "quantity": quantity.strip()}
    if not isinstance(item, dict):
        return item
    fields = lower_keys(cast("dict[str, Any]", item))
    rename(fields, "object", OBJECT)
    rename(fields, "quantity", QUANTITY)
    if isinstance(quantity := fields.get("quantity"), str):
        quantity = quantity.lower() if quantity.lower() in catalogue() else quantity
        fields["quantity"] = without_unit(quantity)
    return fields


def without_unit(quantity: str) -> str:
    """Return `mass` for `mass kg` or `mass [kg]`, as listed in the prompt; other text unchanged."""
    # Remove the text after the id only if it is exactly the quantity's unit.
    id, _, unit = quantity.partition(" ")
    known = catalogue().get(id)
    return id if known is not None and unit.strip(" []()") == known.unit else quantity


def from_text(value: object) -> object:
    """Parse a text with a JSON object or list; return any other value unchanged."""
    if not isinstance(value, str) or value.strip()[:1] not in ("{", "["):
        return value
    if nesting(value) > MAX_NESTING:
        raise InputError(TOO_DEEP)
    try:
        return unique_json(value)
    except ValueError:
        return value


def normalize_tree(value: object) -> object:
    """Normalize every node of a tree and remove a wrapping root.

    A list is a Sequence; a list of one node is that node.
    """
    if isinstance(value, list):
        listed = cast("list[object]", value)
        if len(listed) == 1 and isinstance(listed[0], dict):
            return normalize_tree(cast("object", listed[0]))
        return normalize_tree({"type": "Sequence", "children": listed})
    if not isinstance(value, dict):
        return value
    value = expand_node(cast("dict[str, Any]", value))
    node = normalize_node(cast("dict[str, Any]", value))
    children: object = node.get("children")
    # Remove a root field or a root node with one child.
    if set(node) <= {"root", "name"} and "root" in node:
        return normalize_tree(node["root"])
    if isinstance(children, list):
        node["children"] = [
            normalize_tree(expand_node(each)) for each in cast("list[object]", children)
        ]
        if plain(node.get("type")) in _ROOTS and len(node["children"]) == 1:
            return node["children"][0]
    # Ids belong to the flat form and have no meaning in a tree.
    if "id" not in fields_of(node.get("type")):
        node.pop("id", None)
    return node


_CALL = re.compile(r"\s*([A-Za-z_]\w{0,40})\s*(?:\((.{0,2000})\)\s*)?", re.DOTALL)
_ARGUMENT = re.compile(r"""(?:(\w{1,40})\s*[=:]\s*)?('[^']*'|"[^"]*"|[^,'"]+)(?:,\s*|$)""")


def expand_node(value: object) -> object:
    """Return a node with its type in a field.

    A node may be a call, `MovePose(pose="cup_pose")`, or have the type as the only key:
    `{"sequence": [...]}`, `{"MovePose": {"pose": "cup_pose"}}`, `{"MovePose": "cup_pose"}`.
    """
    if isinstance(value, str) and (call := _CALL.fullmatch(value)):
        texts = _ARGUMENT.findall(call[2] or "")
        return _node(call[1], [(name, text.strip(" '\"")) for name, text in texts], value)
    if not isinstance(value, dict) or len(fields := cast("dict[str, Any]", value)) != 1:
        return cast("object", value)
    ((key, content),) = fields.items()
    if isinstance(content, list) and plain(key) in types():
        return {"type": key, "children": cast("list[object]", content)}
    if isinstance(content, dict):
        return _node(key, list(cast("dict[str, object]", content).items()), fields)
    alone: list[tuple[str, object]] = (
        [] if content in (None, "", True) else [("", cast("object", content))]
    )
    return _node(key, alone, fields)


def _node(name: str, given: Sequence[tuple[str, object]], value: object) -> object:
    """Return a node of a declared type; arguments without a name are in order."""
    type = types().get(plain(name))
    own = list(fields_of(type))
    if type is None or len(given) > max(len(own), 2):
        return value
    free = [field for field in own if field not in dict(given)]
    named = {key or (free.pop(0) if free else "?"): each for key, each in given}
    return {"type": type, **named}


def assign_ids(nodes: Sequence[object]) -> list[object]:
    """Return flat nodes with whole numbers as ids; a `parent` replaces missing `children`."""
    known = [cast("dict[str, Any]", node) for node in nodes if isinstance(node, dict)]
    ids = [node.get("id") for node in known]
    if len(known) != len(nodes) or not all(isinstance(id, int | str) for id in ids):
        return list(nodes)
    places = {id: id if isinstance(id, int) else at for at, id in enumerate(ids)}
    if len(places) != len(ids) or len({isinstance(id, int) for id in ids}) > 1:
        return list(nodes)
    numbered_nodes: list[object] = []
    for node in known:
        below = children_of(node)
        if not any("children" in item for item in known):
            below = [item["id"] for item in known if item.get("parent") == node["id"]]
        rest = {key: each for key, each in node.items() if key != "parent"}
        below = [places.get(item, item) if isinstance(item, int | str) else item for item in below]
        numbered_nodes.append({**rest, "id": places[node["id"]], "children": below})
    return numbered_nodes


def normalize_node(value: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a node in normal form.

    The type is as declared, the arguments are on its level, and optional fields are not null.
    """
    node = lower_keys(value)
    rename(node, "type", TYPE)
    if "type" not in node and plain(node.get("name")) in types():
        node["type"] = node.pop("name")
    own = fields_of(types().get(plain(node.get("type"))))
    # Move wrapped arguments to the level of the type, unless names collide.
    for box in BOXES:
        boxed: object = node.get(box)
        if isinstance(boxed, list) and box not in own and len(cast("list[Any]", boxed)) <= len(own):
            boxed = dict(zip(own, cast("list[Any]", boxed), strict=False))
        if isinstance(boxed, dict) and box not in own:
            inner = lower_keys(cast("dict[str, Any]", boxed))
            if not inner.keys() & node.keys():
                del node[box]
                node |= inner
    # Declared spelling of the type; the remaining steps depend on it.
    node["type"] = types().get(plain(node.get("type")), node.get("type"))
    if node["type"] is None:
        del node["type"]
    own = fields_of(node.get("type"))
    rename(node, "children", [name for name in CHILDREN if name not in own])
    # Optional fields may be null; they are dropped.
    for optional in ("name", "children"):
        if node.get(optional, "") is None:
            del node[optional]
    # Choices are matched in any case.
    for argument, choices in own.items():
        if isinstance(given := node.get(argument), str):
            node[argument] = choices.get(given.strip().lower(), given)
    return node


def normalize_flat_node(item: object) -> object:
    """Return a node of the flat form with integer ids."""
    if not isinstance(item, dict):
        return item

    def number(value: object) -> object:
        if isinstance(value, str) and len(value) <= MAX_DIGITS and re.fullmatch("[0-9]+", value):
            return int(value)
        return value

    node = normalize_node(cast("dict[str, Any]", item))
    if "id" in node:
        node["id"] = number(node["id"])
    if isinstance(node.get("children"), list):
        node["children"] = [number(child) for child in cast("list[object]", node["children"])]
    return node


def is_flat(nodes: Sequence[object]) -> bool:
    """True for nodes with ids whose children are not nodes."""
    fields = [lower_keys(cast("dict[str, Any]", node)) for node in nodes if isinstance(node, dict)]
    children = [child for node in fields for child in children_of(node)]
    # A flat list has ids and refers to children by them.
    named = any("id" in node for node in fields)
    return named and not any(isinstance(child, dict) for child in children)


def plain(name: object) -> str:
    """Remove separators and capitals from a name: `measureforces` for `measure_forces`."""
    return re.sub(r"[\s_-]", "", name).lower() if isinstance(name, str) else ""


@cache
def types() -> Mapping[str, str]:
    """Map plain names to declared node types; ambiguous names are left out."""
    words = vocabulary()
    names: dict[str, list[str]] = {}
    for name in (*words.primitives, *words.composites):
        names.setdefault(plain(name), []).append(name)
    return {key: matches[0] for key, matches in names.items() if len(matches) == 1}


@cache
def arguments(name: str) -> Mapping[str, Mapping[str, str]]:
    """Return the arguments of a primitive, each with its choices by lower-case name."""
    choices_of: dict[str, dict[str, str]] = {}
    for field, schema in vocabulary().primitives[name].model_json_schema()["properties"].items():
        # Choices are enumerations in any branch of the schema.
        forms = schema.get("anyOf", [schema])
        choices = [value for form in forms for value in form.get("enum", ())]
        choices_of[field] = {str(choice).lower(): choice for choice in choices}
    return choices_of


def fields_of(type: object) -> Mapping[str, Mapping[str, str]]:
    """Return the `arguments` of a node type; empty for other types."""
    known = isinstance(type, str) and type in vocabulary().primitives
    return arguments(cast("str", type)) if known else {}
