"""Between a plan's nodes and the primitives that they stand for."""

from __future__ import annotations

from collections.abc import Iterator

from palpate.planning.plan import Node
from palpate.vocabulary.base import Primitive
from palpate.vocabulary.composites import COMPOSITES


def node_of(primitive: Primitive) -> Node:
    """The plan's node for a primitive."""
    return Node(type(primitive).__name__, tuple(primitive.model_dump(exclude_none=True).items()))


def leaves(node: Node, path: str = "tree") -> Iterator[tuple[str, Node]]:
    """The atomic actions below and including `node`, with their paths."""
    for where, found in node.walk(path):
        if not found.children and found.type not in COMPOSITES:
            yield where, found
