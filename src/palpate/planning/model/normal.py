"""Normal form of a plan's document: names, wrappers and forms that can mean one thing only are read as
that. Nothing is evaluated, and the depth is that of the document, which the caller bounds."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, cast

from palpate.errors import InputError
from palpate.planning.model.flat import children_of
from palpate.planning.plan import MAX_NESTING, nesting, unique_json
from palpate.quantities.catalogue import catalogue
from palpate.vocabulary.registry import vocabulary

MAX_DIGITS = 9
"""Digits of a whole number that is written as text."""
TREE = ("root", "behavior_tree", "behaviour_tree")
"""Other names of the field `tree`; `root` may also wrap a plan or a tree."""
TYPE = ("action", "primitive")
"""Other names of a node's `type`."""
CHILDREN = ("nodes", "steps")
"""Other names of a node's `children`."""
BOXES = ("args", "arguments", "params", "parameters")
"""Objects that hold a node's arguments, which stand beside its `type`."""
TOO_DEEP = f"the JSON is nested deeper than {MAX_NESTING} brackets; flatten the tree"

_PLAN_FIELDS = {"outcome", "parameters", "explanation", "tree", "nodes", "scene", *TREE}
_NODE_FIELDS = {"type", "children", "name", "id", *TYPE, *CHILDREN}
_FIELDS = {*_PLAN_FIELDS, *_NODE_FIELDS, "object", "quantity", "again"}
"""Names of fields, which are recognised in any case."""
_ROOTS = ("root", "behaviortree")
"""Types of nodes around a tree, without their separators."""


def is_plan(value: object) -> bool:
    """True for an object with a tree, its name in any case."""
    if not isinstance(value, dict):
        return False
    named = ("tree", "nodes", *TREE)
    return any(key.strip().lower() in named for key in cast("dict[str, Any]", value))


def unwrapped(value: object) -> object:
    """The plan inside an object that holds nothing else; any other value as it is."""
    if isinstance(value, dict) and len(fields := cast("dict[str, object]", value)) == 1:
        (inner,) = fields.values()
        if is_plan(inner):
            return inner
    return cast("object", value)


def normalized(document: Mapping[str, Any]) -> dict[str, Any]:
    """Normalize a plan's document: fields in lower case, parameters as a list of objects, one tree of
    nodes whose types and arguments are named as declared, or a flat list of nodes with numbers as ids.

    Raises:
        InputError: a tree that is written as text is nested too deep, or names a field twice.
    """
    found = lowered(document)
    if "nodes" not in found:
        rename(found, "tree", TREE)
    if "parameters" in found:
        found["parameters"] = normalized_parameters(found["parameters"])
    if isinstance(found.get("outcome"), str):
        found["outcome"] = found["outcome"].strip().lower()
    nodes = found.get("nodes")
    if isinstance(nodes, list):
        listed = cast("list[object]", nodes)
        if "tree" not in found and listed and not is_flat(listed):
            found["tree"] = found.pop("nodes")
        else:
            found["nodes"] = [normalized_flat_node(node) for node in listed]
    if "tree" in found:
        found["tree"] = normalized_tree(from_text(found["tree"]))
    return found


def lowered(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Rename fields to lower case, where that is a field's name and not another field here."""
    found: dict[str, Any] = {}
    for key, value in fields.items():
        name = key.strip().lower()
        known = name in _FIELDS and (name == key or name not in fields)
        found[name if known else key] = value
    return found


def rename(fields: dict[str, Any], name: str, others: Sequence[str]) -> None:
    """Name the only one of some fields `name`, where there is none of that name."""
    given = [other for other in others if other in fields]
    if name not in fields and len(given) == 1:
        fields[name] = fields.pop(given[0])


def normalized_parameters(value: object) -> object:
    """A list of parameters; an object is one parameter, or the quantities of each object."""
    if isinstance(value, dict):
        fields = lowered(cast("dict[str, Any]", value))
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
    return [normalized_parameter(item) for item in cast("list[object]", value)]


def normalized_parameter(item: object) -> object:
    """A parameter as an object; `"cup.mass"` is split at its point, and a unit is left out."""
    if isinstance(item, str) and item.count(".") == 1:
        body, quantity = item.split(".")
        item = {"object": body.strip(), "quantity": quantity.strip()}
    if not isinstance(item, dict):
        return item
    fields = lowered(cast("dict[str, Any]", item))
    if isinstance(fields.get("quantity"), str):
        fields["quantity"] = without_unit(fields["quantity"])
    return fields


def without_unit(quantity: str) -> str:
    """`mass` for `mass kg` and `mass [kg]`, as the prompt lists it; any other text as it is."""
    id, _, unit = quantity.partition(" ")
    known = catalogue().get(id)
    return id if known is not None and unit.strip(" []()") == known.unit else quantity


def from_text(value: object) -> object:
    """The JSON in a text that holds an object or a list; any other value as it is."""
    if not isinstance(value, str) or value.strip()[:1] not in ("{", "["):
        return value
    if nesting(value) > MAX_NESTING:
        raise InputError(TOO_DEEP)
    try:
        return unique_json(value)
    except ValueError:
        return value


def normalized_tree(value: object) -> object:
    """A tree with every node normalized, without a root around it; a list is a Sequence, of one node that
    node."""
    if isinstance(value, list):
        listed = cast("list[object]", value)
        if len(listed) == 1 and isinstance(listed[0], dict):
            return normalized_tree(cast("object", listed[0]))
        return normalized_tree({"type": "Sequence", "children": listed})
    if not isinstance(value, dict):
        return value
    node = normalized_node(cast("dict[str, Any]", value))
    children: object = node.get("children")
    if set(node) <= {"root", "name"} and "root" in node:
        return normalized_tree(node["root"])
    if isinstance(children, list):
        node["children"] = [normalized_tree(each) for each in cast("list[object]", children)]
        if plain(node.get("type")) in _ROOTS and len(node["children"]) == 1:
            return node["children"][0]
    if "id" not in fields_of(node.get("type")):
        node.pop("id", None)  # of the flat form, which has no meaning here
    return node


def normalized_node(value: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of a node: its type as declared, its arguments beside it, and no null in optional
    fields."""
    node = lowered(value)
    rename(node, "type", TYPE)
    own = fields_of(node.get("type"))
    for box in BOXES:
        held: object = node.get(box)
        if isinstance(held, dict) and box not in own:
            inner = lowered(cast("dict[str, Any]", held))
            if not inner.keys() & node.keys():
                del node[box]
                node |= inner
    node["type"] = types().get(plain(node.get("type")), node.get("type"))
    if node["type"] is None:
        del node["type"]
    own = fields_of(node.get("type"))
    rename(node, "children", [name for name in CHILDREN if name not in own])
    for optional in ("name", "children"):
        if node.get(optional, "") is None:
            del node[optional]
    for argument, choices in own.items():
        if isinstance(given := node.get(argument), str):
            node[argument] = choices.get(given.strip().lower(), given)
    return node


def normalized_flat_node(item: object) -> object:
    """A node of the flat form with its id, and those of its children, as numbers."""
    if not isinstance(item, dict):
        return item

    def number(value: object) -> object:
        if isinstance(value, str) and len(value) <= MAX_DIGITS and re.fullmatch("[0-9]+", value):
            return int(value)
        return value

    node = normalized_node(cast("dict[str, Any]", item))
    if "id" in node:
        node["id"] = number(node["id"])
    if isinstance(node.get("children"), list):
        node["children"] = [number(child) for child in cast("list[object]", node["children"])]
    return node


def is_flat(nodes: Sequence[object]) -> bool:
    """True for nodes with ids, whose children are no nodes themselves."""
    fields = [lowered(cast("dict[str, Any]", node)) for node in nodes if isinstance(node, dict)]
    children = [child for node in fields for child in children_of(node)]
    named = any("id" in node for node in fields)
    return named and not any(isinstance(child, dict) for child in children)


def plain(name: object) -> str:
    """A name without separators and capitals: `measureforces` for `measure_forces`."""
    return re.sub(r"[\s_-]", "", name).lower() if isinstance(name, str) else ""


@cache
def types() -> Mapping[str, str]:
    """Declared types of nodes by their plain names; a name that two share is none."""
    words = vocabulary()
    names: dict[str, list[str]] = {}
    for name in (*words.primitives, *words.composites):
        names.setdefault(plain(name), []).append(name)
    return {key: found[0] for key, found in names.items() if len(found) == 1}


@cache
def arguments(name: str) -> Mapping[str, Mapping[str, str]]:
    """Arguments of a primitive, each with its choices by their names in lower case."""
    found: dict[str, dict[str, str]] = {}
    for field, schema in vocabulary().primitives[name].model_json_schema()["properties"].items():
        forms = schema.get("anyOf", [schema])
        choices = [value for form in forms for value in form.get("enum", ())]
        found[field] = {str(choice).lower(): choice for choice in choices}
    return found


def fields_of(type: object) -> Mapping[str, Mapping[str, str]]:
    """As `arguments`, of a node's type; empty for one that is no primitive."""
    known = isinstance(type, str) and type in vocabulary().primitives
    return arguments(cast("str", type)) if known else {}
