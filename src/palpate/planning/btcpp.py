"""BehaviorTree.CPP 4 XML of plans and the vocabulary: written for Groot2, and read as plans."""

from __future__ import annotations

import json
import types
from contextlib import suppress
from typing import Any, Literal, NoReturn, Union, cast, get_args, get_origin
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from pydantic import TypeAdapter, ValidationError

from palpate.common.errors import InputError
from palpate.mjcf import document
from palpate.planning.plan import Node, Plan, plan_json, unique_json
from palpate.primitives.registry import Vocabulary

TREE_ID = "Plan"
METADATA = "TreeNodesModel/SubTree/MetadataFields/Metadata[@plan]"
"""Place of a plan's fields other than the tree, as JSON in the attribute `plan`; BT.CPP ignores it."""
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
    root.append(model := nodes_model(words))
    # The fields other than the tree are metadata of the tree's own model.
    fields = {key: value for key, value in plan_json(plan).items() if key != "tree"}
    metadata = SubElement(SubElement(model, "SubTree", ID=TREE_ID), "MetadataFields")
    SubElement(metadata, "Metadata", plan=json.dumps(fields))
    return document_text(root)


def tree_nodes_model(words: Vocabulary) -> str:
    """The TreeNodesModel of a vocabulary: all primitives with their ports, types and descriptions."""
    root = Element("root", BTCPP_format="4")
    root.append(nodes_model(words))
    return document_text(root)


def add_node(parent: Element, node: Node, words: Vocabulary) -> None:
    composite = words.composites.get(node.type)
    element = SubElement(parent, composite.btcpp["tag"] if composite else "Action")
    arguments = {} if composite else words.arguments(node.type, dict(node.args))
    ports = {"ID": None if composite else node.type, "name": node.name or None, **arguments}
    for name, value in ports.items():
        if value is not None:
            element.set(name, port_value(value))
    for name, value in implied_attributes(node.type, words).items():
        element.set(name, value)
    for child in node.children:
        add_node(element, child, words)


def implied_attributes(type: str, words: Vocabulary) -> dict[str, str]:
    """Return the attributes of a node with one possible value: a composite's own, or a buffer's entry."""
    if type in words.composites:
        return {key: v for key, v in words.composites[type].btcpp.items() if key != "tag"}
    primitive = words.primitives.get(type)
    buffers = (primitive.reads, primitive.writes) if primitive else ()
    return {buffer: f"{{{buffer}}}" for buffer in buffers if buffer}


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


# Reading. The result is the JSON document of a plan; `parse_plan` and the check judge it.


# Tags of the explicit form, `<Action ID="MovePose" .../>`; the compact form is `<MovePose .../>`.
EXPLICIT = ("Action", "Condition", "Control", "Decorator")
LABELS = ("_description", "_fullpath", "_uid")  # Attributes of Groot2 without an effect


def read_tree_xml(text: str, words: Vocabulary) -> dict[str, Any]:
    """Convert a BT.CPP document to the JSON document of a plan; only metadata states `parameters`.

    Raises InputError: unsafe or malformed XML, no main tree, or a part that a plan cannot express.
    """
    root = document.parse_xml(text, "the plan")
    trees, main = list(root.iter("BehaviorTree")), root.get("main_tree_to_execute")
    chosen = [tree for tree in trees if main in (None, tree.get("ID"))]
    nodes = [node for tree in chosen for node in document.children(tree)]
    if len(chosen) != 1 or len(nodes) != 1:
        listed = ", ".join(str(tree.get("ID"))[:40] for tree in trees) or "none"
        raise InputError(
            f"the plan is XML with the root <{str(root.tag)[:40]}> and the behavior trees: {listed}; give one "
            "<BehaviorTree> with one root node, or name it in main_tree_to_execute"
        )
    fields: dict[str, Any] = {}
    for metadata in root.iterfind(METADATA):
        try:
            fields = dict(cast("dict[str, Any]", unique_json(metadata.get("plan", ""))))
        except (TypeError, ValueError) as error:
            refuse(metadata, f"'plan' is not a JSON object: {error}")
    fields = {key: value for key, value in fields.items() if key in Plan.__slots__}
    return {**fields, "tree": read_node(nodes[0], words)}


def read_node(element: document.Element, words: Vocabulary) -> dict[str, Any]:
    """Return a node and its children as JSON. Raises InputError: an attribute that no plan can express."""
    given = {str(key): str(text) for key, text in element.attrib.items() if key not in LABELS}
    type = given.pop("ID", str(element.tag)) if element.tag in EXPLICIT else str(element.tag)
    if element.tag == "SubTree":
        refuse(element, "subtrees are not read; put the nodes of that tree here")
    fields = words.primitives[type].model_fields if type in words.primitives else {}
    implied, node = implied_attributes(type, words), dict[str, Any](type=type)
    for key, text in given.items():
        if text != implied.get(key, text) or key.startswith("_") or key in ("type", "children"):
            remedy = f'write {key}="{implied[key]}"' if key in implied else "remove it"
            refuse(element, f'a plan cannot express {key[:40]}="{text[:40]}"; {remedy}')
        if text.startswith("{") and key not in ("name", *implied):
            refuse(element, f"{key[:40]} refers to the entry {text[:40]}; give its value")
        if key not in implied:
            node[key] = port_argument(text, fields[key].annotation if key in fields else str)
    children = [read_node(child, words) for child in document.children(element)]
    return node | ({"children": children} if children else {})


def port_argument(text: str, annotation: Any) -> object:
    """Convert the text of a port, the inverse of `port_value`; text of another type stays for the check."""
    for value in (text.split(";"), text):
        with suppress(ValidationError):
            return TypeAdapter[object](annotation).validate_python(value)
    return text


def refuse(element: document.Element, problem: str) -> NoReturn:
    raise InputError(f"the plan, {document.label(element)}: {problem}")
