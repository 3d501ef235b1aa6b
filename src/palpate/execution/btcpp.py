"""BehaviorTree.CPP 4 XML of plans and the vocabulary, for Groot2."""

from __future__ import annotations

import types
from collections.abc import Mapping
from typing import Any, Literal, Union, get_args, get_origin
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from palpate.common.errors import InputError
from palpate.planning.plan import Node, Plan
from palpate.primitives.base import Primitive
from palpate.primitives.registry import Vocabulary

TREE_ID = "Plan"
BUFFER_TYPE = "palpate::Recording"
TYPES: dict[object, str] = {str: "std::string", bool: "bool", int: "int", float: "double"}


def tree_xml(plan: Plan, words: Vocabulary) -> str:
    """A plan as a BT.CPP 4 document, with the model of its nodes for Groot2.

    Arguments become ports. Buffers that primitives write and read become blackboard entries, e.g.
    `gripper_forces="{gripper_forces}"`. Elements of lists are separated by semicolons, as BT.CPP
    expects. Raises InputError: the plan has no tree, or names an unknown node.
    """
    if plan.tree is None:
        raise InputError(f"the plan has no tree to write: {plan.explanation}")
    root = Element("root", BTCPP_format="4", main_tree_to_execute=TREE_ID)
    add_node(SubElement(root, "BehaviorTree", ID=TREE_ID), plan.tree, words)
    root.append(nodes_model(words))
    return document_text(root)


def tree_nodes_model(words: Vocabulary) -> str:
    """The TreeNodesModel of a vocabulary: all primitives with their ports, types and descriptions."""
    root = Element("root", BTCPP_format="4")
    root.append(nodes_model(words))
    return document_text(root)


def add_node(parent: Element, node: Node, words: Vocabulary) -> None:
    if node.type in words.composites:
        fixed = dict(words.composites[node.type].btcpp)
        element = SubElement(parent, fixed.pop("tag"), fixed)
    else:
        element = SubElement(parent, "Action", ID=node.type)
    if node.name:
        element.set("name", port_value(node.name))
    if node.type not in words.composites:
        arguments = words.arguments(node.type, dict(node.args))
        set_ports(element, words.primitive(node.type), arguments)
        return
    for child in node.children:
        add_node(element, child, words)


def set_ports(element: Element, primitive: type[Primitive], args: Mapping[str, Any]) -> None:
    """Set a primitive's arguments and buffers as attributes of its element."""
    for name, value in args.items():
        if value is not None:
            element.set(name, port_value(value))
    for buffer in (primitive.reads, primitive.writes):
        if buffer:
            element.set(buffer, f"{{{buffer}}}")


def nodes_model(words: Vocabulary) -> Element:
    model = Element("TreeNodesModel")
    for name, primitive in words.primitives.items():
        action = SubElement(model, "Action", ID=name)
        # Arguments are input ports; a default is stated if there is one.
        for argument, field in primitive.model_fields.items():
            port = SubElement(action, "input_port", name=argument, type=port_type(field.annotation))
            if not field.is_required() and field.default is not None:
                port.set("default", port_value(field.default))
            port.text = field.description
        # Buffers are ports that refer to blackboard entries.
        for tag, buffer in (("input_port", primitive.reads), ("output_port", primitive.writes)):
            if buffer:
                port = SubElement(action, tag, name=buffer, type=BUFFER_TYPE)
                port.set("default", f"{{{buffer}}}")
                port.text = "the latest recording"
        metadata = SubElement(action, "MetadataFields")
        SubElement(metadata, "Metadata", description=primitive.summary())
    return model


def port_type(annotation: Any) -> str:
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is list:
        return f"std::vector<{port_type(arguments[0])}>"
    if origin is Literal:
        return port_type(type(arguments[0]))
    if origin in (Union, types.UnionType):
        # An optional type has the port type of its other part; a true union is text.
        kinds = {port_type(a) for a in arguments if a is not type(None)}
        return kinds.pop() if len(kinds) == 1 else "std::string"
    return TYPES.get(annotation, "std::string")


def port_value(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return ";".join(port_value(v) for v in value)  # pyright: ignore[reportUnknownVariableType]
    text = repr(value) if isinstance(value, float) else str(value)
    # XML cannot carry control characters.
    return "".join(c if c.isprintable() else "\ufffd" for c in text)


def document_text(root: Element) -> str:
    ElementTree.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'
