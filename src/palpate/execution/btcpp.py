"""Plans, trees that are being run, and the vocabulary as BehaviorTree.CPP 4 XML, which Groot2 opens."""

from __future__ import annotations

import types
from collections.abc import Mapping
from typing import Any, Literal, Union, get_args, get_origin
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from py_trees.behaviour import Behaviour

from palpate.errors import InputError
from palpate.execution.build import leaves
from palpate.execution.leaf import PrimitiveLeaf
from palpate.planning.plan import Node, Plan
from palpate.vocabulary.base import Primitive
from palpate.vocabulary.registry import COMPOSITES, Vocabulary

TREE_ID = "Plan"
BUFFER_TYPE = "palpate::Recording"
TYPES: dict[object, str] = {str: "std::string", bool: "bool", int: "int", float: "double"}


def tree_xml(plan: Plan, words: Vocabulary) -> str:
    """A plan as a BT.CPP 4 document, with the model of its nodes so that Groot2 knows them.

    Arguments become ports; the buffers that primitives write and read become blackboard entries,
    e.g. `gripper_forces="{gripper_forces}"`. Lists are separated by semicolons, as BT.CPP parses
    them.

    Raises:
        InputError: the plan has no tree, or names an unknown node.
    """
    if plan.tree is None:
        raise InputError(f"the plan has no tree to write: {plan.explanation}")
    root = Element("root", BTCPP_format="4", main_tree_to_execute=TREE_ID)
    tree = SubElement(root, "BehaviorTree", ID=TREE_ID)
    _add(tree, plan.tree, words)
    root.append(_model(words))
    return _text(root)


def running_xml(root: Behaviour, numbers: Mapping[Behaviour, int]) -> str:
    """A tree that is being run, as Groot2 is told of it: every node under its type, with the number
    that its statuses go by (source: BehaviorTree.CPP 4.8, `WriteTreeToXML` with metadata)."""
    document = Element("root", BTCPP_format="4")
    tree = SubElement(document, "BehaviorTree", ID=TREE_ID, _fullpath="")
    _add_running(tree, root, numbers)
    used = {type(leaf.primitive).__name__: type(leaf.primitive) for leaf in leaves(root)}
    document.append(_model(Vocabulary(used)))
    return _text(document)


def tree_nodes_model(words: Vocabulary) -> str:
    """The TreeNodesModel of a vocabulary: every primitive with its ports, their types and
    descriptions."""
    root = Element("root", BTCPP_format="4")
    root.append(_model(words))
    return _text(root)


def _add(parent: Element, node: Node, words: Vocabulary) -> None:
    if node.type in words.composites:
        fixed = dict(words.composites[node.type].btcpp)
        element = SubElement(parent, fixed.pop("tag"), fixed)
        if node.name:
            element.set("name", _value(node.name))
        for child in node.children:
            _add(element, child, words)
        return
    element = SubElement(parent, "Action", ID=node.type)
    if node.name:
        element.set("name", _value(node.name))
    _set_ports(element, words.primitive(node.type), words.arguments(node.type, dict(node.args)))


def _add_running(parent: Element, node: Behaviour, numbers: Mapping[Behaviour, int]) -> None:
    if isinstance(node, PrimitiveLeaf):
        kind = type(node.primitive)
        element = SubElement(parent, kind.__name__)
        _set_ports(element, kind, dict(node.primitive))
    else:
        fixed = dict(COMPOSITES[type(node).__name__].btcpp)
        element = SubElement(parent, fixed.pop("tag"), fixed)
    element.set("name", _value(node.name))
    element.set("_uid", str(numbers[node]))
    for child in node.children:
        _add_running(element, child, numbers)


def _set_ports(element: Element, primitive: type[Primitive], args: Mapping[str, Any]) -> None:
    """A primitive's arguments and buffers."""
    for name, value in args.items():
        if value is not None:
            element.set(name, _value(value))
    for buffer in (primitive.reads, primitive.writes):
        if buffer:
            element.set(buffer, f"{{{buffer}}}")


def _model(words: Vocabulary) -> Element:
    model = Element("TreeNodesModel")
    for name, primitive in words.primitives.items():
        action = SubElement(model, "Action", ID=name)
        _ports(action, primitive)
        SubElement(
            SubElement(action, "MetadataFields"), "Metadata", description=primitive.summary()
        )
    return model


def _ports(action: Element, primitive: type[Primitive]) -> None:
    for name, field in primitive.model_fields.items():
        port = SubElement(action, "input_port", name=name, type=_type(field.annotation))
        if not field.is_required() and field.default is not None:
            port.set("default", _value(field.default))
        port.text = field.description
    for tag, buffer in (("input_port", primitive.reads), ("output_port", primitive.writes)):
        if buffer:
            port = SubElement(action, tag, name=buffer, type=BUFFER_TYPE)
            port.set("default", f"{{{buffer}}}")
            port.text = "the latest recording"


def _type(annotation: Any) -> str:
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is list:
        return f"std::vector<{_type(arguments[0])}>"
    if origin is Literal:
        return _type(type(arguments[0]))
    if origin in (Union, types.UnionType):
        kinds = {_type(a) for a in arguments if a is not type(None)}
        return kinds.pop() if len(kinds) == 1 else "std::string"
    return TYPES.get(annotation, "std::string")


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return ";".join(_value(v) for v in value)  # pyright: ignore[reportUnknownVariableType]
    text = repr(value) if isinstance(value, float) else str(value)
    return "".join(c if c.isprintable() else "\ufffd" for c in text)


def _text(root: Element) -> str:
    ElementTree.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'
