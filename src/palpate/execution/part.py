"""A part of a plan."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from palpate.planning.plan import Node, Plan


def part_of(plan: Plan, leaves: Collection[str]) -> Plan:
    """The plan with those of its leaves that have these paths (`tree.children[3]`), in their order;
    branches beside each other stay together. Without any it has no tree."""
    if plan.tree is None:
        return plan
    return replace(plan, tree=_part(plan.tree, leaves, "tree"))


def _part(node: Node, leaves: Collection[str], path: str) -> Node | None:
    if node.type != "Sequence":
        wanted = any(found in leaves for found, _ in node.walk(path))
        return node if wanted else None
    kept: list[Node] = []
    for i, child in enumerate(node.children):
        part = _part(child, leaves, f"{path}.children[{i}]")
        if part is not None:
            kept.append(part)
    return replace(node, children=tuple(kept)) if kept else None
