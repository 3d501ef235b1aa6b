"""Folding leaves over the symbolic state: what would be believed if they succeeded."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from palpate.planning.plan import Node
from palpate.vocabulary.base import Primitive
from palpate.vocabulary.registry import vocabulary
from palpate.vocabulary.state import SymbolicState, merged


def node_of(primitive: Primitive) -> Node:
    """The plan's node for a primitive."""
    return Node(type(primitive).__name__, tuple(primitive.model_dump(exclude_none=True).items()))


def primitive_of(node: Node) -> Primitive:
    """The primitive a leaf stands for.

    Raises:
        InputError: unknown primitive. pydantic.ValidationError: arguments that do not fit.
    """
    return vocabulary().make(node.type, dict(node.args))


def leaves(node: Node, path: str = "tree") -> Iterator[tuple[str, Node]]:
    """The atomic actions below and including `node`, with their paths."""
    return (
        (p, n)
        for p, n in node.walk(path)
        if not n.children and n.type not in vocabulary().composites
    )


def during(moving: Iterable[Primitive], state: SymbolicState) -> SymbolicState:
    """What is so while `moving` run: what a sensing leaf beside them records."""
    for primitive in moving:
        state = primitive.during(state)
    return state


def beside(
    moving: Sequence[Primitive], sensing: Sequence[Primitive], state: SymbolicState
) -> SymbolicState:
    """The state after a Parallel of one moving and one sensing branch."""
    after, sensed = state, during(moving, state)
    for primitive in moving:
        after = primitive.effects(after)
    for primitive in sensing:
        sensed = primitive.effects(sensed)
    return merged(after, [sensed], state)
