"""The plan as a file and as a type: parameters, explanation, tree."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from palpate.quantities import Gap


@dataclass(frozen=True, slots=True)
class Node:
    """One node of a plan's tree: its type, its arguments and its children, in order.

    `args` are the primitive's own (`{"pose": "bottle_pose + z_offset"}`); composites have `children`.
    """

    type: str
    args: tuple[tuple[str, Any], ...] = ()
    children: tuple[Node, ...] = ()
    name: str = ""

    def walk(self, path: str = "tree") -> Iterator[tuple[str, Node]]:
        """This node and all below it, depth first, each with its path (`tree.children[3]`)."""
        yield path, self
        for i, child in enumerate(self.children):
            yield from child.walk(f"{path}.children[{i}]")


@dataclass(frozen=True, slots=True)
class Plan:
    """What a planner returns. `tree` is None when the request cannot be measured; the explanation says why."""

    parameters: tuple[Gap, ...]
    tree: Node | None
    explanation: str
    planner: str = ""
    notes: tuple[str, ...] = ()
    """Remarks for the result, e.g. that a requested quantity is known already."""
