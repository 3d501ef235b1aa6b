"""The plan's tree with what became of each node."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from palpate.planning.plan import Node, Plan
from palpate.trace.recording import LeafRun
from palpate.trace.samples import Trace
from palpate.vocabulary.registry import COMPOSITES, vocabulary

LEAF = "→"
LONGEST_LABEL = 160
NARROWEST = 0.6
"""Per cent: a leaf that took no time is still seen."""

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
    return _branch(plan.tree, "tree", runs, _end(trace))


def aftermath(plan: Plan, trace: Trace | None) -> list[Branch]:
    """Actions of a controlled stop, outside of the plan."""
    if trace is None:
        return []
    planned: set[str] = set()
    if plan.tree is not None:
        planned = {path for path, _ in plan.tree.walk()}
    beside: list[Branch] = []
    for run in trace.leaves:
        if run.node not in planned:
            beside.append(_leaf(run.primitive, run.label, run, _end(trace)))
    return beside


def first_failure(tree: Branch | None) -> Branch | None:
    """The leaf that failed, or else was stopped, first."""
    leaves = list(_leaves(tree)) if tree is not None else []
    for fate in ("failure", "stopped"):
        for leaf in leaves:
            if leaf.fate == fate:
                return leaf
    return None


def _leaves(branch: Branch) -> Iterator[Branch]:
    if not branch.children:
        yield branch
    for child in branch.children:
        yield from _leaves(child)


def _end(trace: Trace | None) -> float:
    """End of the last leaf, robot time (s)."""
    if trace is None or not trace.leaves:
        return 1.0
    return max(leaf.end for leaf in trace.leaves)


def _branch(node: Node, path: str, runs: Mapping[str, LeafRun], end: float) -> Branch:
    if node.type in COMPOSITES:
        return _composite(node, path, runs, end)
    arguments = ", ".join(str(value) for _, value in node.args)
    return _leaf(node.type, f"{node.type}({arguments})", runs.get(path), end)


def _leaf(primitive: str, label: str, run: LeafRun | None, end: float) -> Branch:
    group = summary = ""
    if (declared := vocabulary().primitives.get(primitive)) is not None:
        group, summary = declared.group, declared.summary()
    label = label[:LONGEST_LABEL]
    if run is None:
        return Branch(LEAF, label, group, "waiting", summary)
    return Branch(
        LEAF,
        label,
        group,
        FATES[run.status],
        summary,
        f"{run.end - run.start:.1f} s",
        *_place(run.start, run.end, end),
        run.message,
    )


def _composite(node: Node, path: str, runs: Mapping[str, LeafRun], end: float) -> Branch:
    """A composite lasts from its first leaf's start to its last leaf's end."""
    composite = COMPOSITES[node.type]
    children: list[Branch] = []
    for i, child in enumerate(node.children):
        children.append(_branch(child, f"{path}.children[{i}]", runs, end))
    label, fate = node.name or node.type, _fate(children)
    under = [leaf for at, leaf in runs.items() if at.startswith(f"{path}.")]
    if not under:
        return Branch(
            composite.symbol, label, "composite", fate, composite.summary, children=tuple(children)
        )
    start, stop = min(leaf.start for leaf in under), max(leaf.end for leaf in under)
    return Branch(
        composite.symbol,
        label,
        "composite",
        fate,
        composite.summary,
        f"{stop - start:.1f} s",
        *_place(start, stop, end),
        children=tuple(children),
    )


def _fate(children: Sequence[Branch]) -> str:
    """A composite's fate, from its children's: failure outweighs all else."""
    fates = {child.fate for child in children}
    for fate in ("failure", "stopped"):
        if fate in fates:
            return fate
    return "success" if fates == {"success"} else "waiting"


def _place(start: float, stop: float, end: float) -> tuple[float, float]:
    """Left and width in a run that lasts until `end`, per cent."""
    return round(100 * start / end, 2), round(max(100 * (stop - start) / end, NARROWEST), 2)
