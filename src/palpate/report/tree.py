"""The plan's tree with the result of each node."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from palpate.planning.plan import Node, Plan
from palpate.trace.recording import LeafRun
from palpate.trace.samples import Trace
from palpate.vocabulary.registry import COMPOSITES, vocabulary

LEAF = "→"
LONGEST_LABEL = 160
NARROWEST = 0.6
"""Per cent: least width of a leaf, so that one without duration is visible."""

FATES = {"SUCCESS": "success", "FAILURE": "failure", "INVALID": "stopped"}


@dataclass(frozen=True, slots=True)
class Branch:
    """A node of the tree with its fate; `left` and `width` place it in the run, in per cent."""

    symbol: str
    label: str
    group: str
    fate: str
    summary: str
    duration: str = ""
    left: float = 0.0
    width: float = 0.0
    message: str = ""
    children: tuple[Branch, ...] = ()


def primitive_groups() -> dict[str, str]:
    """Group of each registered primitive."""
    return {name: primitive.group for name, primitive in vocabulary().primitives.items()}


def branches(plan: Plan, trace: Trace | None) -> Branch | None:
    """The plan's tree, from its root."""
    if plan.tree is None:
        return None
    runs: dict[str, LeafRun] = {}
    if trace is not None:
        runs = {leaf.node: leaf for leaf in trace.leaves}
    return branch_of(plan.tree, "tree", runs, last_end(trace))


def aftermath(plan: Plan, trace: Trace | None) -> list[Branch]:
    """Actions of a controlled stop, outside of the plan."""
    if trace is None:
        return []
    planned = {path for path, _ in plan.tree.walk()} if plan.tree is not None else set[str]()
    return [
        leaf_branch(run.primitive, run.label, run, last_end(trace))
        for run in trace.leaves
        if run.node not in planned
    ]


def first_failure(tree: Branch | None) -> Branch | None:
    """The first leaf that failed, else the first that was stopped."""
    leaves = list(leaves_of(tree)) if tree is not None else []
    for fate in ("failure", "stopped"):
        for leaf in leaves:
            if leaf.fate == fate:
                return leaf
    return None


def leaves_of(branch: Branch) -> Iterator[Branch]:
    if not branch.children:
        yield branch
    for child in branch.children:
        yield from leaves_of(child)


def last_end(trace: Trace | None) -> float:
    """End of the last leaf, robot time (s)."""
    if trace is None or not trace.leaves:
        return 1.0
    return max(leaf.end for leaf in trace.leaves)


def branch_of(node: Node, path: str, runs: Mapping[str, LeafRun], end: float) -> Branch:
    if node.type in COMPOSITES:
        return composite_branch(node, path, runs, end)
    arguments = ", ".join(str(value) for _, value in node.args)
    return leaf_branch(node.type, f"{node.type}({arguments})", runs.get(path), end)


def leaf_branch(primitive: str, label: str, run: LeafRun | None, end: float) -> Branch:
    group = summary = ""
    if (declared := vocabulary().primitives.get(primitive)) is not None:
        group, summary = declared.group, declared.summary()
    label = label[:LONGEST_LABEL]
    if run is None:
        return Branch(LEAF, label, group, "waiting", summary)
    left, width = placement(run.start, run.end, end)
    return Branch(
        LEAF,
        label,
        group,
        FATES[run.status],
        summary,
        duration=f"{run.end - run.start:.1f} s",
        left=left,
        width=width,
        message=run.message,
    )


def composite_branch(node: Node, path: str, runs: Mapping[str, LeafRun], end: float) -> Branch:
    composite = COMPOSITES[node.type]
    children = tuple(
        branch_of(child, f"{path}.children[{i}]", runs, end)
        for i, child in enumerate(node.children)
    )
    # A failed or stopped child decides; success takes all children.
    fates = {child.fate for child in children}
    fate = "success" if fates == {"success"} else "waiting"
    fate = next((decisive for decisive in ("failure", "stopped") if decisive in fates), fate)
    branch = Branch(
        composite.symbol,
        node.name or node.type,
        "composite",
        fate,
        composite.summary,
        children=children,
    )
    # A composite lasts from its first leaf's start to its last leaf's end.
    leaves = [leaf for at, leaf in runs.items() if at.startswith(f"{path}.")]
    if not leaves:
        return branch
    start, stop = min(leaf.start for leaf in leaves), max(leaf.end for leaf in leaves)
    left, width = placement(start, stop, end)
    return replace(branch, duration=f"{stop - start:.1f} s", left=left, width=width)


def placement(start: float, stop: float, end: float) -> tuple[float, float]:
    """Left and width in per cent of a run that lasts until `end`."""
    return round(100 * start / end, 2), round(max(100 * (stop - start) / end, NARROWEST), 2)
