"""Py_trees tree of a plan."""

from __future__ import annotations

from collections.abc import Iterator

from py_trees.behaviour import Behaviour
from py_trees.common import ParallelPolicy
from py_trees.composites import Parallel, Sequence
from pydantic import ValidationError

from palpate.errors import InputError
from palpate.execution.leaf import PrimitiveLeaf
from palpate.planning.plan import Node
from palpate.vocabulary.base import Blackboard
from palpate.vocabulary.registry import Vocabulary


def build(node: Node, words: Vocabulary, blackboard: Blackboard, path: str = "tree") -> Behaviour:
    """The py_trees tree of a plan, its leaves bound to `blackboard`.

    A Sequence has memory; a Parallel succeeds when all its children have and fails with the first.
    Inside a Parallel motions are ticked before sensing leaves, in any order of the plan, so
    that a sensing leaf sees in one tick that the motion beside it has started or ended.

    Raises:
        InputError: unknown node type, arguments that do not fit, or an empty composite, which
            py_trees would take for a success.
    """
    if node.type not in words.composites:
        try:
            primitive = words.make(node.type, dict(node.args))
        except ValidationError as error:
            problem = error.errors()[0]
            where = ".".join(str(part) for part in problem["loc"])
            raise InputError(f"{path}: {node.type}: {where}: {problem['msg']}") from None
        return PrimitiveLeaf(primitive, blackboard, path, node.name)
    if not node.children:
        raise InputError(
            f"{path}: an empty {node.type} does nothing; give it children or remove it"
        )
    children = [
        build(child, words, blackboard, f"{path}.children[{i}]")
        for i, child in enumerate(node.children)
    ]
    name = node.name or node.type
    if node.type == "Sequence":
        return Sequence(name, memory=True, children=children)
    children.sort(key=lambda child: not any(leaf.primitive.claims for leaf in leaves(child)))
    return Parallel(name, policy=ParallelPolicy.SuccessOnAll(), children=children)


def leaves(root: Behaviour) -> Iterator[PrimitiveLeaf]:
    """All leaves below and including `root`, in the order of ticks."""
    return (node for node in root.iterate() if isinstance(node, PrimitiveLeaf))
