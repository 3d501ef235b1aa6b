"""A part of a plan, by the paths of its leaves."""

from __future__ import annotations

from palpate.execution.part import part_of
from palpate.planning.plan import Node, Plan


def plan(*children: Node) -> Plan:
    return Plan((), Node("Sequence", children=children), "")


def leaf(name: str) -> Node:
    return Node(name)


def test_leaves_keep_their_order_and_what_is_beside_each_other_stays_together() -> None:
    beside = Node("Parallel", children=(leaf("MovePose"), leaf("MeasureForces")))
    inner = Node("Sequence", children=(leaf("OpenGripper"), leaf("CloseGripper")))
    whole = plan(leaf("MoveJoints"), inner, beside, leaf("MovePose"))
    part = part_of(whole, {"tree.children[2].children[0]", "tree.children[1].children[0]"})
    assert part.tree is not None
    assert str(part.tree).split() == [
        *("Sequence", "Sequence", "OpenGripper"),
        *("Parallel", "MovePose", "MeasureForces"),
    ]
    assert part_of(whole, [path for path, _ in whole.tree.walk()]) == whole  # type: ignore[union-attr]


def test_nothing_of_it_is_no_tree() -> None:
    assert part_of(plan(leaf("MovePose")), ()).tree is None
    assert part_of(Plan((), None, "why"), {"tree"}).tree is None
