"""From the run's types to what the template prints: numbers with sensible digits, bars in per cent,
rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from palpate.estimation.contact import tip_height
from palpate.estimation.estimate import Estimate, rounded
from palpate.geometry.pose import Array
from palpate.parameter import Parameter
from palpate.planning.plan import Node, Plan
from palpate.quantities.quantity import QUANTITIES
from palpate.report.data import Measured, ParameterRow
from palpate.trace.recording import LeafRun, Recording
from palpate.trace.samples import FORCES, Trace
from palpate.vocabulary.composites import COMPOSITES
from palpate.vocabulary.registry import vocabulary

AXES = {2: ("x", "y"), 3: ("x", "y", "z"), 6: ("xx", "yy", "zz", "xy", "xz", "yz")}
"""Names of the components of a vector, and of a symmetric tensor in MuJoCo's `fullinertia`
order."""

SMALL = {"kg": ("g", 1e3), "m": ("mm", 1e3)}
"""Units in which errors are easier to read."""

OFF_SCALE = 5.0
"""A truth farther than so many interval half widths is drawn at the edge, lest the interval
vanish."""


@dataclass(frozen=True, slots=True)
class Interval:
    """One component of an estimate; `left`, `width`, `dot`, `truth_at` in per cent of the bar."""

    axis: str
    value: str
    std: str
    low: str
    high: str
    left: float
    width: float
    dot: float
    truth: str | None = None
    truth_at: float | None = None
    error: str | None = None
    covered: bool | None = None


@dataclass(frozen=True, slots=True)
class Evidence:
    """A measured window: when, what was so, what was read, and its signal as an SVG polyline in 100
    x 24."""

    name: str
    what: str
    when: str
    reading: str
    line: str


@dataclass(frozen=True, slots=True)
class Card:
    """An estimate as it is printed."""

    object: str
    quantity: str
    unit: str
    verdict: str
    method: str
    intervals: tuple[Interval, ...]
    further: tuple[tuple[str, str], ...]
    evidence: tuple[Evidence, ...]


@dataclass(frozen=True, slots=True)
class Branch:
    """A node of the tree with its fate; `left` and `width` place it in the run, in per cent."""

    symbol: str
    label: str
    group: str
    status: str
    duration: str
    left: float
    width: float
    message: str
    summary: str
    children: tuple[Branch, ...]


def quantity_label(id: str) -> str:
    """In words, or the id itself where a quantity is not in the catalogue."""
    return QUANTITIES[id].label if id in QUANTITIES else id


def _unit(quantity: str) -> str:
    unit = QUANTITIES[quantity].unit if quantity in QUANTITIES else "1"
    return "" if unit == "1" else f" {unit}"


def cards(measured: Sequence[Measured], trace: Trace | None) -> list[Card]:
    """One per estimate."""
    return [_card(m, trace) for m in measured]


def _card(measured: Measured, trace: Trace | None) -> Card:
    e = measured.estimate
    axes = AXES.get(len(e.value), ("",) * len(e.value))
    truths = (
        measured.truth
        if measured.truth and len(measured.truth) == len(e.value)
        else (None,) * len(e.value)
    )
    intervals = tuple(
        _interval(*row, measured.unit)
        for row in zip(axes, e.value.tolist(), e.std.tolist(), e.ci95.tolist(), truths, strict=True)
    )
    further = tuple(
        (name, _further(part.value, part.std, part.unit or e.unit))
        for name, part in e.parts.items()
    )
    evidence = tuple(_evidence(r, trace, e.parameter) for r in e.evidence) if trace else ()
    return Card(
        e.parameter.object,
        quantity_label(e.parameter.quantity),
        "" if measured.unit == "1" else measured.unit,
        e.verdict,
        e.method,
        intervals,
        further,
        evidence,
    )


def _interval(
    axis: str, value: float, std: float, ci: tuple[float, float], truth: float | None, unit: str
) -> Interval:
    shown, spread = rounded(value, std)
    low, high = (rounded(bound, std)[0] for bound in ci)
    half = max((ci[1] - ci[0]) / 2, 1e-12)
    reach = 1.35 * half
    if truth is not None:
        reach = max(reach, min(1.2 * abs(truth - value), OFF_SCALE * half))

    def percent(x: float) -> float:
        return round(min(max(50 + 50 * (x - value) / reach, 0.0), 100.0), 2)

    left = percent(ci[0])
    plain = Interval(axis, shown, spread, low, high, left, round(percent(ci[1]) - left, 2), 50.0)
    if truth is None:
        return plain
    return replace(
        plain,
        truth=f"{truth:.6g}",
        truth_at=percent(truth),
        covered=ci[0] <= truth <= ci[1],
        error=_error(value, truth, unit, relative=not axis),
    )


def _further(value: float, std: float, unit: str) -> str:
    name, factor = SMALL[unit] if unit in SMALL and abs(value) < 1e-2 else (unit, 1.0)
    return " ± ".join(rounded(factor * value, factor * std)) + (f" {name}" if name != "1" else "")


def _error(value: float, truth: float, unit: str, relative: bool) -> str:
    name, factor = SMALL.get(unit, (unit, 1.0))
    error = f"{factor * (value - truth):+.2g}" + (f" {name}" if name != "1" else "")
    share = f" ({100 * (value - truth) / truth:+.2g} %)" if relative and truth else ""
    return (error + share).replace("-", "−")


def in_words(measured: Sequence[Measured]) -> tuple[str, str]:
    """What was unknown, and what it is: two captions."""
    found = [card for card in cards(measured, None) if card.intervals]
    unknown = [f"{card.object} {card.quantity} ?" for card in found]
    known = [
        f"{c.object} {c.quantity} {' '.join(i.value for i in c.intervals)} {c.unit}".rstrip()
        for c in found
    ]
    return ", ".join(unknown), ", ".join(known)


def windows(trace: Trace, estimates: Sequence[Estimate]) -> dict[Recording, str]:
    """Every recording with the name of what it is evidence of."""
    of: dict[Recording, list[str]] = {recording: [] for recording in trace.recordings}
    claims = [(r, e.parameter) for e in estimates for r in e.evidence]
    claims += [(c.recording, Parameter(c.object, c.quantity)) for c in trace.conversions]
    for recording, parameter in claims:
        name = f"{parameter.object} {quantity_label(parameter.quantity)}"
        if recording in of and name not in of[recording]:
            of[recording].append(name)
    return {
        r: ", ".join(names)
        or f"{r.context.activity} {r.context.holding or r.context.support or ''}".strip()
        for r, names in of.items()
    }


def _evidence(recording: Recording, trace: Trace, parameter: Parameter) -> Evidence:
    c = recording.context
    about = [
        c.activity,
        f"holding {c.holding}" if c.holding else "",
        f"on {c.support}" if c.support else "",
        f"at {c.at}" if c.at else "",
    ]
    name, unit, signal = _signal(recording, trace)
    reading = "no samples"
    if len(signal):
        spread = " ± ".join(rounded(float(signal.mean()), float(signal.std())))
        reading = f"{name} = {spread}{unit}, {len(signal)} sample{'s' if len(signal) > 1 else ''}"
    return Evidence(
        f"{parameter.object} {quantity_label(parameter.quantity)}",
        ", ".join(filter(None, about)),
        f"{recording.start:.2f}–{recording.end:.2f} s",
        reading,
        _polyline(signal),
    )


def _signal(recording: Recording, trace: Trace) -> tuple[str, str, Array]:
    """What a recording shows at a glance: its name, its unit and its samples."""
    if recording.reading:
        return "reading", "", np.array(recording.reading)
    samples = trace.of(recording)
    if recording.buffer == FORCES:
        return "Fz", " N", samples.wrench[:, 2]
    return "fingertips z", " m", tip_height(samples, trace.hand)


def _polyline(signal: Array, points: int = 80) -> str:
    """The signal's block means in a box 100 wide and 24 high."""
    if len(signal) < 2:
        return ""
    blocks = np.array([block.mean() for block in np.array_split(signal, min(points, len(signal)))])
    span = float(np.ptp(blocks)) or 1.0
    x, y = np.linspace(0, 100, len(blocks)), 22 - 20 * (blocks - blocks.min()) / span
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))


def parameter_groups(
    rows: Sequence[ParameterRow], measured: Sequence[Measured]
) -> list[tuple[str, list[tuple[ParameterRow, str, str]]]]:
    """Rows by object, each with its quantity in words and its value as text."""
    found = {m.estimate.parameter: m for m in measured if m.estimate.verdict != "not identified"}
    return [
        (name, [(row, quantity_label(row.quantity), _value(row, found)) for row in group])
        for name, group in groupby(rows, key=lambda row: row.object)
    ]


def _value(row: ParameterRow, found: Mapping[Parameter, Measured]) -> str:
    now = found.get(Parameter(row.object, row.quantity))
    unstated = {"known": "–", "missing": "?", "assumed": "as of uniform density"}[row.state]
    before = " ".join(f"{v:.6g}" for v in row.value) if row.value else unstated
    if now is None:
        return before if not row.value else f"{before}{_unit(row.quantity)}"
    pairs = zip(now.estimate.value, now.estimate.std, strict=True)
    return f"{before} → {' '.join(rounded(v, s)[0] for v, s in pairs)}{_unit(row.quantity)}"


def primitive_groups() -> dict[str, str]:
    """Which group each registered primitive belongs to."""
    return {name: cls.group for name, cls in vocabulary().primitives.items()}


def branches(plan: Plan, trace: Trace | None) -> Branch | None:
    """The plan's tree with what became of each node."""
    if plan.tree is None:
        return None
    runs = {leaf.node: leaf for leaf in trace.leaves} if trace else {}
    return _branch(plan.tree, "tree", runs, _end(trace))


def aftermath(plan: Plan, trace: Trace | None) -> list[Branch]:
    """What ran beside the plan: the actions of a controlled stop."""
    planned = {path for path, _ in plan.tree.walk()} if plan.tree else set[str]()
    runs = trace.leaves if trace else ()
    return [
        _leaf(run.primitive, run.label, run, _end(trace)) for run in runs if run.node not in planned
    ]


def _end(trace: Trace | None) -> float:
    return max((leaf.end for leaf in trace.leaves), default=1.0) if trace else 1.0


def _branch(node: Node, path: str, runs: Mapping[str, LeafRun], end: float) -> Branch:
    if node.type in COMPOSITES:
        return _composite(node, path, runs, end)
    label = f"{node.type}({', '.join(str(value) for _, value in node.args)})"
    return _leaf(node.type, label, runs.get(path), end)


def _leaf(primitive: str, label: str, run: LeafRun | None, end: float) -> Branch:
    cls = vocabulary().primitives.get(primitive)
    group, summary = (cls.group, cls.summary()) if cls else ("", "")
    if run is None:
        return Branch("→", label[:160], group, "waiting", "", 0, 0, "", summary, ())
    return Branch(
        "→",
        label[:160],
        group,
        _STATUS[run.status],
        f"{run.end - run.start:.1f} s",
        *_place(run.start, run.end, end),
        run.message,
        summary,
        (),
    )


def _composite(node: Node, path: str, runs: Mapping[str, LeafRun], end: float) -> Branch:
    composite = COMPOSITES[node.type]
    children = tuple(
        _branch(child, f"{path}.children[{i}]", runs, end) for i, child in enumerate(node.children)
    )
    under = [leaf for at, leaf in runs.items() if at.startswith(f"{path}.")]
    start, stop = (
        min((x.start for x in under), default=0.0),
        max((x.end for x in under), default=0.0),
    )
    return Branch(
        composite.symbol,
        node.name or node.type,
        "composite",
        _fate([c.status for c in children]),
        f"{stop - start:.1f} s" if under else "",
        *_place(start, stop, end),
        "",
        composite.summary,
        children,
    )


_STATUS = {"SUCCESS": "success", "FAILURE": "failure", "INVALID": "stopped"}


def _fate(statuses: Sequence[str]) -> str:
    """A composite's final status, from its children's."""
    for status in ("failure", "stopped"):
        if status in statuses:
            return status
    return "success" if statuses and all(s == "success" for s in statuses) else "waiting"


def _place(start: float, stop: float, end: float) -> tuple[float, float]:
    return round(100 * start / end, 2), round(max(100 * (stop - start) / end, 0.6), 2)
