"""Estimates and parameters on the page: a card for each, a table of many, and the scene's
values."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING, Literal

import numpy as np

from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Estimate
from palpate.estimation.quantities.catalogue import catalogue
from palpate.runs.figures import ComponentText, figures, format_values
from palpate.runs.report.changes import RecordingEntry, evidence, quantity_label
from palpate.runs.report.charts import (
    Axis,
    Chart,
    Truth,
    charts,
    error_text,
    plain,
    with_spread,
    with_unit,
)
from palpate.trace.samples import Trace
from palpate.twin.inject import stated_parameter

if TYPE_CHECKING:
    from palpate.runs.run import Run

MARGIN = 1.35  # Distance from the middle of a bar to its end, in half widths of the interval
TRUTH_MARGIN = 1.2  # Distance from the middle of a bar to its end, in distances of the truth
# Half widths of the interval. A truth farther away is drawn at the end of the bar, so that the
# interval stays visible.
OFF_SCALE = 5.0
FEW = 4  # Largest count of cards without a table above them
AIR = 0.04  # Share of a common scale that stays free at each end
IN_TWIN = ("identified", "prior-dominated")  # Verdicts of values that the twin holds
# Placeholder for a missing value.
UNSTATED = {"known": "–", "missing": "?", "assumed": "as of uniform density"}


@dataclass(frozen=True, slots=True)
class TruthMark:
    """True value of the simulated world; `at` in per cent of the bar."""

    value: str
    at: float
    error: str
    covered: bool
    number: float


@dataclass(frozen=True, slots=True, kw_only=True)
class IntervalBar(ComponentText):
    """Component of an estimate as a bar, with the value in the middle."""

    # left, width: of the interval, in per cent of the bar.
    left: float
    width: float
    truth: TruthMark | None
    number: float  # the value
    bounds: tuple[float, float]  # ends of the interval


@dataclass(frozen=True, slots=True)
class EstimateCard:
    """An estimate as printed on the page."""

    estimate: Estimate
    quantity: str  # its name in words
    unit: str  # as printed: none for a pure number
    intervals: tuple[IntervalBar, ...]
    further: tuple[tuple[str, str], ...]
    evidence: tuple[RecordingEntry, ...]
    anchor: str
    charts: tuple[Chart, ...]


def cards(run: Run) -> list[EstimateCard]:
    """Cards, one per estimate."""
    return [
        estimate_card(
            estimate, run.truth.get(estimate.parameter), run.trace_if_any, f"estimate-{i}"
        )
        for i, estimate in enumerate(run.estimates, 1)
    ]


def estimate_card(
    estimate: Estimate, truth: Truth | None, trace: Trace | None, anchor: str
) -> EstimateCard:
    unit = estimate.unit
    # Results of the estimate in addition to its values, as a static friction.
    further = [
        (name, with_spread(part.value, part.std, part.unit or unit))
        for name, part in estimate.parts.items()
    ]
    # Windows and charts need the trace.
    windows: list[RecordingEntry] = []
    if trace is not None:
        windows = [evidence(recording, trace) for recording in estimate.evidence]
    return EstimateCard(
        estimate,
        quantity_label(estimate.parameter.quantity),
        "" if unit == "1" else unit,
        intervals=tuple(component_intervals(estimate, truth)),
        further=tuple(further),
        evidence=tuple(windows),
        anchor=anchor,
        charts=charts(estimate, truth) if trace is not None and len(trace.samples) else (),
    )


def component_intervals(estimate: Estimate, truth: Truth | None) -> Iterator[IntervalBar]:
    # A truth of another size cannot be compared component by component.
    truths: Sequence[float | None] = truth or ()
    if len(truths) != len(estimate.values):
        truths = (None,) * len(estimate.values)
    for i, (figure, true) in enumerate(zip(figures(estimate), truths, strict=True)):
        # Scale the bar to the interval, and to the truth if it is near.
        value = float(estimate.values[i])
        low, high = estimate.intervals[i].tolist()
        half = max((high - low) / 2, 1e-12)  # an exact value has an interval of no width
        reach = MARGIN * half
        if true is not None:  # a truth farther away than `OFF_SCALE` is drawn at the bar's end
            reach = max(reach, min(TRUTH_MARGIN * abs(true - value), OFF_SCALE * half))
        bar = Axis(value - reach, value + reach)
        left, right = clipped_percent(bar, low), clipped_percent(bar, high)
        # Mark the truth of a simulated world.
        revealed = None
        if true is not None:
            error = error_text(value, true, estimate.unit, relative=not figure.axis)
            at, covered = clipped_percent(bar, true), low <= true <= high
            revealed = TruthMark(f"{true:.6g}", at, error, covered, true)
        yield IntervalBar(
            **asdict(figure),
            left=left,
            width=round(right - left, 2),
            truth=revealed,
            number=value,
            bounds=(low, high),
        )


def clipped_percent(bar: Axis, value: float) -> float:
    """Position on the bar in per cent, at one of its ends for a value outside."""
    return min(max(bar.per_cent(value), 0.0), 100.0)


def in_words(cards: Iterable[EstimateCard]) -> tuple[str, str]:
    """Captions of the pictures: the names of the estimated quantities, and names with values."""
    unknown: list[str] = []
    known: list[str] = []
    for card in cards:
        if card.intervals:
            name = f"{card.estimate.parameter.object} {card.quantity}"
            values = " ".join(interval.limit or interval.value for interval in card.intervals)
            unknown.append(name)
            known.append(with_unit(f"{name} {values}", card.unit))
    return ", ".join(unknown), ", ".join(known)


@dataclass(frozen=True, slots=True)
class QuantityScale:
    """All components of one quantity on one axis, the largest first, and estimates without a value."""

    quantity: str
    unit: str
    axis: Axis
    rows: tuple[tuple[EstimateCard, IntervalBar], ...]
    without: tuple[EstimateCard, ...]


def forest(cards: Sequence[EstimateCard]) -> list[QuantityScale]:
    """Forest plot of many estimates: one scale per quantity; empty for few cards."""
    if len(cards) <= FEW:
        return []
    # One scale for each quantity and unit.
    kinds: dict[tuple[str, str], list[EstimateCard]] = {}
    for card in cards:
        kinds.setdefault((card.quantity, card.unit), []).append(card)
    return [quantity_scale(quantity, unit, of) for (quantity, unit), of in kinds.items()]


def quantity_scale(quantity: str, unit: str, cards: Sequence[EstimateCard]) -> QuantityScale:
    # Each component of a vector is a row, on the scale of its quantity.
    rows = [(card, interval) for card in cards for interval in card.intervals]
    rows.sort(key=lambda row: row[1].number, reverse=True)
    # The common axis includes all intervals and truths.
    ends: list[float] = []
    for _, interval in rows:
        ends += interval.bounds
        if interval.truth is not None:
            ends.append(interval.truth.number)
    axis = Axis.enclose(np.array(ends or [0.0, 1.0]), AIR)
    empty = tuple(card for card in cards if not card.intervals)
    return QuantityScale(quantity, unit, axis, tuple(rows), empty)


State = Literal["known", "missing", "assumed"]


@dataclass(frozen=True, slots=True)
class ParameterText:
    """Quantity of the scene as text: its status, its value before and after, and whether the request names it."""

    quantity: str
    state: State
    value: str
    asked: bool


def parameter_groups(run: Run) -> dict[str, list[ParameterText]]:
    """Missing, known and assumed quantities of the scene, by body."""
    # Compare under the names of the scene. Measured values are those that the twin holds.
    stated = partial(stated_parameter, quantities=catalogue())
    asked = set(map(stated, run.plan.parameters))
    estimates = {stated(e.parameter): e for e in run.estimates if e.verdict in IN_TWIN}
    groups: dict[str, list[ParameterText]] = {}
    for name, body in run.scene.bodies.items():
        states: dict[State, Mapping[str, tuple[float, ...]]] = {
            "missing": dict.fromkeys(sorted(body.missing), ()),
            "known": body.known,
            "assumed": dict.fromkeys(sorted(body.assumed), ()),
        }
        for state, values in states.items():
            for id, value in values.items():
                parameter = Parameter(name, id)
                text = value_text(id, state, value, estimates.get(parameter))
                row = ParameterText(quantity_label(id), state, text, parameter in asked)
                groups.setdefault(name, []).append(row)
    return groups


def value_text(id: str, state: State, value: tuple[float, ...], now: Estimate | None) -> str:
    """Format the scene's value, followed by an arrow and the measured one."""
    unit = catalogue()[id].unit if id in catalogue() else ""
    before = plain(value) if value else UNSTATED[state]
    if now is not None:
        return with_unit(f"{before} → {format_values(now)}", unit)
    return with_unit(before, unit) if value else before
