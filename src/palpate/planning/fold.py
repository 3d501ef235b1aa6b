"""Folding leaves over the symbolic state: what would be believed if they succeeded."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from palpate.planning.plan import Node
from palpate.vocabulary.primitive import Primitive, vocabulary
from palpate.vocabulary.state import SymbolicState


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
    return ((p, n) for p, n in node.walk(path) if not n.children and n.type not in vocabulary().composites)


def during(moving: Iterable[Primitive], state: SymbolicState) -> SymbolicState:
    """What is so while `moving` run: what a sensing leaf beside them records."""
    for primitive in moving:
        state = primitive.during(state)
    return state


def merged(after: SymbolicState, sensed: Iterable[SymbolicState], before: SymbolicState) -> SymbolicState:
    """The state `after` what moved, with all that was recorded and converted in `sensed` branches meanwhile."""
    for branch in sensed:
        after = replace(after, buffers={**after.buffers, **_new(branch, before)},
                        logged=(*after.logged, *branch.logged[len(before.logged):]),
                        converted=after.converted | branch.converted)
    return after


def beside(moving: Sequence[Primitive], sensing: Sequence[Primitive], state: SymbolicState) -> SymbolicState:
    """The state after a Parallel of one moving and one sensing branch."""
    after, sensed = state, during(moving, state)
    for primitive in moving:
        after = primitive.effects(after)
    for primitive in sensing:
        sensed = primitive.effects(sensed)
    return merged(after, [sensed], state)


def _new(branch: SymbolicState, before: SymbolicState) -> dict[str, object]:
    return {name: context for name, context in branch.buffers.items() if before.buffers.get(name) is not context}
