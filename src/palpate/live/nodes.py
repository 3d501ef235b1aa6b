"""The nodes of a tree that is being run, and how far it is."""

from __future__ import annotations

from collections.abc import Iterator

from py_trees.behaviour import Behaviour

from palpate.execution.leaf import PrimitiveLeaf
from palpate.execution.runner import Snapshot


def walk(node: Behaviour, depth: int = 0) -> Iterator[tuple[Behaviour, int]]:
    """This node and all below it, depth first, each with how deep it stands."""
    yield node, depth
    for child in node.children:
        yield from walk(child, depth + 1)


def steps_of(snapshot: Snapshot) -> list[PrimitiveLeaf]:
    """The plan's leaves."""
    return [node for node, _ in walk(snapshot.root) if isinstance(node, PrimitiveLeaf)]


def step_of(snapshot: Snapshot) -> tuple[int, int]:
    """Number of the running step, and of all steps."""
    steps = len(steps_of(snapshot))
    return min(len(snapshot.leaves) + 1, steps), steps
