"""Sections of the report: held-out motions, proof, poses, tree."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from palpate.common.belief import Belief
from palpate.common.pose import Array, Pose
from palpate.estimation.estimate import round_to_std
from palpate.planning.plan import Node, Plan
from palpate.primitives.registry import COMPOSITES, vocabulary
from palpate.runs.figures import significant
from palpate.runs.held_out import Curve, HeldOut, HeldOutMotion
from palpate.runs.proof import Proof, ProvedTask, typical
from palpate.trace.recording import LeafRun
from palpate.trace.samples import Trace

SHOWN = 3  # Count of panels for a motion: the signals with the largest effect of the object
GAP = 0.4  # s: longest interval between two bins that a line joins
WIDTH, HEIGHT, EDGE = 300.0, 130.0, 8.0  # Pixels: size of a panel, and its margin


@dataclass(frozen=True, slots=True)
class Point:
    """A measured mean, with one standard deviation on each side, in the panel."""

    x: float
    y: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Panel:
    """Panel of a signal. The range `low` to `high` in `unit` is from bottom to top, `start` to
    `end` in s from left to right. Lines are SVG points.
    """

    name: str
    unit: str
    low: str
    high: str
    start: str
    end: str
    points: tuple[Point, ...]
    twin: tuple[str, ...]
    template: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Prediction:
    """A predicted motion with its panels."""

    title: str
    agrees: bool
    text: str
    disagreement: str
    panels: tuple[Panel, ...]


def predictions(held_out: HeldOut | None) -> list[Prediction]:
    """Make the panels of the predictions, one entry for each motion."""
    rows: list[Prediction] = []
    for motion in held_out.motions if held_out is not None else ():
        title = motion.motion[:1].upper() + motion.motion[1:]
        panels = tuple(signal_panels(motion.curve))
        rows.append(
            Prediction(title, motion.agrees, prediction_text(motion), motion.disagreement, panels)
        )
    return rows


def prediction_text(motion: HeldOutMotion) -> str:
    direction = "more" if motion.weight > 0 else "less"
    weight, std = round_to_std(1e3 * abs(motion.weight), 1e3 * motion.weight_std)
    return (
        f"The joint torques were predicted to {significant(1e3 * motion.rms, 2)} mN·m (root mean square), where "
        f"the scene as given would have been {significant(1e3 * motion.rms_template, 3)} mN·m off. Against what noise "
        f"and uncertainty allow, χ² is {motion.chi2:.0f} at {motion.dof} degrees of freedom (p = {motion.p:.2g}), and "
        f"{motion.chi2_template:.0f} for the scene as given. The {motion.object} weighed {weight} ± {std} g "
        f"{direction} than predicted."
    )


def signal_panels(curve: Curve) -> Iterator[Panel]:
    """Make panels of the signals with the largest predicted values, in the curve's order."""
    t = np.array(curve.t)
    peaks = np.abs(np.array(curve.twin)).max(axis=1)
    # Select the largest: joints on which the object has no lever show only noise.
    largest: list[int] = np.argsort(-peaks, kind="stable").tolist()
    # Break the lines where the motion has gaps.
    breaks: list[int] = (np.flatnonzero(np.diff(t) > GAP) + 1).tolist()
    parts = [slice(first, last) for first, last in pairwise([0, *breaks, len(t)])]
    for i in sorted(largest[:SHOWN]):
        twin, guess = np.array(curve.twin[i]), np.array(curve.template[i])
        measured, std = np.array(curve.measured[i]), np.array(curve.std[i])
        # Scale both axes to the data with their deviations.
        spread = np.concatenate([twin, guess, measured - std, measured + std])
        low, high = float(spread.min()), float(spread.max())
        x = scaled_to_pixels(t, (float(t[0]), float(t[-1])), (EDGE, WIDTH - EDGE))
        up = partial(scaled_to_pixels, ends=(low, high), pixels=(HEIGHT - EDGE, EDGE))
        columns = (x, up(measured), up(measured - std), up(measured + std))
        signal = curve.signals[i]
        _, joint, number = signal.rpartition("joint")  # `fr3_joint4` is joint 4
        yield Panel(
            name=f"joint {number.strip('_')}" if joint else signal,
            unit="N" if signal.startswith("F") else "N·m",
            low=f"{low:.3g}",
            high=f"{high:.3g}",
            start=f"{t[0]:.1f}",
            end=f"{t[-1]:.1f}",
            points=tuple(Point(*row) for row in np.column_stack(columns).tolist()),
            twin=tuple(polyline(x[part], up(twin)[part]) for part in parts),
            template=tuple(polyline(x[part], up(guess)[part]) for part in parts),
        )


def scaled_to_pixels(
    values: Array, ends: tuple[float, float], pixels: tuple[float, float]
) -> Array:
    """Map `values` linearly from `ends` to `pixels`, rounded to a tenth of a pixel."""
    share = (values - ends[0]) / max(ends[1] - ends[0], 1e-9)
    return np.asarray(np.round(pixels[0] + (pixels[1] - pixels[0]) * share, 1), dtype=np.float64)


def polyline(x: Array, y: Array) -> str:
    points = list(zip(x.tolist(), y.tolist(), strict=True))
    if len(points) == 1:  # a single point is drawn as a short dash
        middle, height = points[0]
        points = [(middle - EDGE, height), (middle + EDGE, height)]
    return " ".join(f"{a:g},{b:g}" for a, b in points)


# Proof of the twin: a line through the goal for each task, with prior, twin and promise.

MARGIN = 0.1  # Share of half the line that stays free at its end


@dataclass(frozen=True, slots=True)
class TaskDrawing:
    """Drawing of a task. Positions are in per cent of a line with the goal in its middle; None for a
    result without a position, e.g. a fall.
    """

    # title, says: name and description of the task.
    title: str
    says: str
    # prior, twin: positions.
    prior: float | None
    twin: float | None
    band: tuple[float, float] | None  # start and width of the twin's promise
    results: tuple[str, str, str]  # results of prior and twin, and the promise, as text


def lines(proof: Proof | None) -> list[TaskDrawing]:
    """Draw the tasks on which a measured value has an effect."""
    if proof is None:
        return []
    return [_line(row) for row in proof.rows if row.depends]


def _line(row: ProvedTask) -> TaskDrawing:
    # Scale the line to the largest finite error.
    prior, twin = (typical(errors) for errors in (row.prior, row.twin))
    low, high = row.promise
    reach = max(abs(error) for error in (prior, twin, low, high, 1e-9) if np.isfinite(error))
    start, end = _place(low / reach), _place(high / reach)
    band = None if start is None or end is None else (start, round(max(end - start, 0.3), 1))
    goal, prior_result, twin_result, promise = row.cells()[2:]
    return TaskDrawing(
        f"{row.object}: {row.task}, {goal}",
        row.says,
        _place(prior / reach),
        _place(twin / reach),
        band,
        (prior_result, twin_result, promise),
    )


def _place(share: float) -> float | None:
    """Convert a share of half the line to per cent of the line."""
    return round(50 + 50 * (1 - MARGIN) * share, 1) if np.isfinite(share) else None


def iter_insensitive_tasks(proof: Proof | None) -> Iterator[str]:
    """List the tasks without a line."""
    if proof is None:
        return
    for row in proof.rows:
        if not row.depends:
            yield f"{row.object}: nothing that was measured matters for this task: {row.task}"
    yield from proof.left_out


# Poses of objects: by sight, by touch, and by both.


@dataclass(frozen=True, slots=True)
class PoseRow:
    """Pose of an object as text; `both` is empty if nothing touched it."""

    object: str
    sight: str
    touches: tuple[str, ...]
    both: str
    contradiction: str


def pose_rows(beliefs: Mapping[str, Belief]) -> Iterator[PoseRow]:
    """List the poses of objects that were seen."""
    for name, belief in beliefs.items():
        touches = tuple(f"{touch.means}: {touch.description}" for touch in belief.touches)
        both = _in_words(belief.pose, belief.covariance) if touches else ""
        sight = _in_words(belief.seen, belief.seen_covariance)
        yield PoseRow(name, sight, touches, both, belief.contradiction)


def _in_words(pose: Pose, covariance: Array) -> str:
    """Format a position to a tenth of a millimetre, with standard deviations."""
    # The first three coordinates of the covariance are the position.
    stds = np.sqrt(np.diag(covariance)[:3])
    parts = zip("xyz", (1e3 * pose.position).tolist(), (1e3 * stds).tolist(), strict=True)
    return ", ".join(f"{axis} {value:.1f} ± {std:.1f}" for axis, value, std in parts)


# The plan's tree with the result of each node.

LEAF = "→"
LONGEST_LABEL = 160
NARROWEST = 0.6  # Per cent: least width of a leaf, so that one without duration is visible

FATES = {"SUCCESS": "success", "FAILURE": "failure", "INVALID": "stopped"}


@dataclass(frozen=True, slots=True)
class Branch:
    """A node of the tree with its result. `left` and `width` are its place in the run, in per cent."""

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


def branches(plan: Plan, trace: Trace | None) -> Branch | None:
    """Make the plan's tree for the page, from its root."""
    if plan.tree is None:
        return None
    # Leaves without a run are still waiting.
    runs: dict[str, LeafRun] = {}
    if trace is not None:
        runs = {leaf.node: leaf for leaf in trace.leaves}
    return branch_of(plan.tree, "tree", runs, last_end(trace))


def list_stop_actions(plan: Plan, trace: Trace | None) -> list[Branch]:
    """List the actions of a controlled stop, which are outside of the plan."""
    if trace is None:
        return []
    planned = {path for path, _ in plan.tree.walk()} if plan.tree is not None else set[str]()
    return [
        leaf_branch(run.primitive, run.label, run, last_end(trace))
        for run in trace.leaves
        if run.node not in planned
    ]


def first_failure(tree: Branch | None) -> Branch | None:
    """Find the first leaf that failed, else the first that was stopped."""
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
    """End of the last leaf, robot time, s."""
    if trace is None or not trace.leaves:
        return 1.0
    return max(leaf.end for leaf in trace.leaves)


def branch_of(node: Node, path: str, runs: Mapping[str, LeafRun], end: float) -> Branch:
    if node.type in COMPOSITES:
        return composite_branch(node, path, runs, end)
    arguments = ", ".join(str(value) for _, value in node.args)
    return leaf_branch(node.type, f"{node.type}({arguments})", runs.get(path), end)


def leaf_branch(primitive: str, label: str, run: LeafRun | None, end: float) -> Branch:
    # The vocabulary here may lack a primitive of the plan.
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
    # A failed or stopped child determines the result; success needs all children.
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
    # Duration: from the start of the first leaf to the end of the last one.
    leaves = [leaf for at, leaf in runs.items() if at.startswith(f"{path}.")]
    if not leaves:
        return branch
    start, stop = min(leaf.start for leaf in leaves), max(leaf.end for leaf in leaves)
    left, width = placement(start, stop, end)
    return replace(branch, duration=f"{stop - start:.1f} s", left=left, width=width)


def placement(start: float, stop: float, end: float) -> tuple[float, float]:
    """Left edge and width, in per cent of a run that lasts until `end`."""
    return round(100 * start / end, 2), round(max(100 * (stop - start) / end, NARROWEST), 2)
