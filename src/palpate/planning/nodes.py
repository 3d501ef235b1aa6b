"""Between a plan's nodes and the primitives that they stand for."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, cast

from palpate.planning.plan import Node
from palpate.vocabulary.base import Primitive
from palpate.vocabulary.registry import COMPOSITES


def node_of(primitive: Primitive) -> Node:
    """The plan's node for a primitive: its arguments as they stand in a file."""
    arguments: list[tuple[str, Any]] = []
    for name, value in primitive.model_dump(mode="json", exclude_none=True).items():
        if isinstance(value, list):
            value = tuple(cast("list[object]", value))
        arguments.append((name, value))
    return Node(type(primitive).__name__, tuple(arguments))


def leaves(node: Node, path: str = "tree") -> Iterator[tuple[str, Node]]:
    """The atomic actions below and including `node`, with their paths."""
    for where, found in node.walk(path):
        if not found.children and found.type not in COMPOSITES:
            yield where, found
