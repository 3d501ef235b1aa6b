"""Estimates as cards: value, error, interval on a bar, and where a world is simulated its truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from palpate.report.axis import Axis
from palpate.report.data import Measured
from palpate.report.evidence.charts import Chart, charts
from palpate.report.evidence.windows import Evidence, evidence, quantity_label
from palpate.report.numbers import error_text, with_spread, with_unit
from palpate.runs.figures import Figure, figures
from palpate.trace.samples import Trace

MARGIN = 1.35
"""Half widths of the interval from the middle of a bar to its end."""

OFF_SCALE = 5.0
"""A truth farther than so many interval half widths is drawn at the edge, lest the interval
vanish."""


@dataclass(frozen=True, slots=True)
class Truth:
    """True value of the simulated world; `at` in per cent of the bar."""

    value: str
    at: float
    error: str
    covered: bool
    number: float


@dataclass(frozen=True, slots=True)
class Interval:
    """Component of an estimate; the interval's `left` and `width` in per cent of the bar, in whose
    middle the value stands."""

    axis: str
    value: str
    std: str
    low: str
    high: str
    left: float
    width: float
    truth: Truth | None
    verdict: str
    number: float
    bounds: tuple[float, float]

    @property
    def reach(self) -> tuple[float, ...]:
        """Its bounds, and the truth where that is known."""
        return self.bounds if self.truth is None else (*self.bounds, self.truth.number)


@dataclass(frozen=True, slots=True)
class Card:
    """An estimate as it is printed."""

    object: str
    quantity: str
    unit: str
    verdict: str
    contradiction: str
    method: str
    intervals: tuple[Interval, ...]
    further: tuple[tuple[str, str], ...]
    evidence: tuple[Evidence, ...]
    anchor: str
    charts: tuple[Chart, ...]


@dataclass(frozen=True, slots=True)
class _Bar:
    """A bar with a value in its middle that reaches `reach` to either side."""

    middle: float
    reach: float

    def place(self, value: float) -> float:
        """Per cent from the left end, at one of the ends where the value is off the bar."""
        axis = Axis(self.middle - self.reach, self.middle + self.reach)
        return min(max(axis.per_cent(value), 0.0), 100.0)


def cards(measured: Sequence[Measured], trace: Trace | None) -> list[Card]:
    """Cards, one per estimate."""
    return [_card(m, trace, f"estimate-{i + 1}") for i, m in enumerate(measured)]


def _card(measured: Measured, trace: Trace | None, anchor: str) -> Card:
    estimate = measured.estimate
    unit = estimate.unit
    further: list[tuple[str, str]] = []
    for name, part in estimate.parts.items():
        further.append((name, with_spread(part.value, part.std, part.unit or unit)))
    windows: list[Evidence] = []
    if trace is not None:
        windows = [evidence(recording, trace) for recording in estimate.evidence]
    return Card(
        estimate.parameter.object,
        quantity_label(estimate.parameter.quantity),
        "" if unit == "1" else unit,
        estimate.verdict,
        estimate.contradiction,
        estimate.method,
        _intervals(measured),
        tuple(further),
        tuple(windows),
        anchor,
        charts(measured) if trace is not None and len(trace.samples) else (),
    )


def _intervals(measured: Measured) -> tuple[Interval, ...]:
    estimate = measured.estimate
    count = len(estimate.values)
    truths: Sequence[float | None] = measured.truth or ()
    if len(truths) != count:
        truths = (None,) * count
    found: list[Interval] = []
    for i, figure in enumerate(figures(estimate)):
        value, ci = float(estimate.values[i]), estimate.intervals[i].tolist()
        found.append(_interval(figure, value, (ci[0], ci[1]), truths[i], estimate.unit))
    return tuple(found)


def _interval(
    figure: Figure, value: float, ci: tuple[float, float], truth: float | None, unit: str
) -> Interval:
    bar = _bar(value, ci, truth)
    left, right = bar.place(ci[0]), bar.place(ci[1])
    revealed = None
    if truth is not None:
        error = error_text(value, truth, unit, relative=not figure.axis)
        covered = ci[0] <= truth <= ci[1]
        revealed = Truth(f"{truth:.6g}", bar.place(truth), error, covered, truth)
    return Interval(
        figure.axis,
        figure.value,
        figure.std,
        figure.low,
        figure.high,
        left,
        round(right - left, 2),
        revealed,
        figure.verdict,
        value,
        ci,
    )


def _bar(value: float, ci: tuple[float, float], truth: float | None) -> _Bar:
    """The interval with some air beside it, and the truth too unless it is far away."""
    half = max((ci[1] - ci[0]) / 2, 1e-12)
    reach = MARGIN * half
    if truth is not None:
        reach = max(reach, min(1.2 * abs(truth - value), OFF_SCALE * half))
    return _Bar(value, reach)


def in_words(measured: Sequence[Measured]) -> tuple[str, str]:
    """Captions of the unknown and of its value."""
    unknown: list[str] = []
    known: list[str] = []
    for card in cards(measured, None):
        if not card.intervals:
            continue
        name = f"{card.object} {card.quantity}"
        values = " ".join(interval.value for interval in card.intervals)
        unknown.append(f"{name} ?")
        known.append(with_unit(f"{name} {values}", card.unit))
    return ", ".join(unknown), ", ".join(known)
