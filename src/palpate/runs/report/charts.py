"""Charts of fits, and numbers formatted as text."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array
from palpate.estimation.estimate import Z95, Estimate, FitView, round_to_std
from palpate.runs.figures import figures
from palpate.runs.report.plots import (
    FAINT,
    LEGEND,
    MARK,
    NORM,
    Figure,
    decimate,
    pack_array,
    scatter,
)

Truth = tuple[float, ...]  # True values of a simulated world, one for each component
SMALL = {"kg": ("g", 1e3), "m": ("mm", 1e3)}  # Units in which errors are easier to read


@dataclass(frozen=True, slots=True)
class Axis:
    """An axis from `low` to `high`."""

    low: float
    high: float

    @classmethod
    def enclose(cls, values: Array, air: float) -> Axis:
        """Axis that spans all `values`, with a margin of `air` times their range."""
        # Constant values get a margin by their size.
        low, high = float(np.min(values)), float(np.max(values))
        margin = air * (high - low) or 0.1 * abs(high) or 1.0
        return cls(low - margin, high + margin)

    def per_cent(self, value: float) -> float:
        """Position of a number along the axis: 0 at `low`, 100 at `high`."""
        return round(100.0 * ((value - self.low) / (self.high - self.low)), 2)


def plain(values: Iterable[float]) -> str:
    """Format exactly known values, separated by spaces."""
    return " ".join(f"{value:.6g}" for value in values)


def with_unit(text: str, unit: str) -> str:
    """Append the unit to `text`; a pure number, of unit 1, has none."""
    if unit in ("", "1"):
        return text
    return f"{text} {unit}"


def with_spread(value: float, std: float, unit: str) -> str:
    """Format value and deviation, as `0.262 ± 0.020 kg`. Values below a hundredth of the unit get a smaller unit."""
    # Grams and millimetres are easier to read than small SI numbers.
    factor = 1.0
    if abs(value) < 1e-2:
        unit, factor = SMALL.get(unit, (unit, 1.0))
    texts = round_to_std(factor * value, factor * std)
    return with_unit(" ± ".join(texts) if std > 0.0 else texts[0], unit)


def error_text(value: float, truth: float, unit: str, relative: bool) -> str:
    """Format the error of `value` against the truth, in the smaller unit; with the `relative` error if requested."""
    unit, factor = SMALL.get(unit, (unit, 1.0))
    text = with_unit(f"{factor * (value - truth):+.2g}", unit)
    if relative and truth:
        text += f" ({100 * (value - truth) / truth:+.2g} %)"
    return text.replace("-", "−")


# Charts of the fits behind an estimate: measured values with error bars, predictions with their
# bands.

TRUTH = "#c2710c"
COLOURS = (MARK, TRUTH, "#3b82f6")
"""Colours of the points of the first, second and third group."""
BAND = "rgba(13, 148, 136, .2)"
MANY = 60  # Count of points above which a group is drawn as a line
# Multiple of the median standard deviation above which error bars do not stretch the axis.
WIDE = 4.0
# Range of the predictions, in standard deviations, above which residuals get a second axis.
BARELY_SEEN = 40.0
SHORT, TALL = 300, 430  # px, height of a chart without and with residuals

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Chart:
    """Figure of plotly.js with its caption."""

    title: str
    note: str
    figure: Figure


def charts(estimate: Estimate, truth: Truth | None = None) -> tuple[Chart, ...]:
    """A chart for each fit behind an estimate."""
    drawn: list[Chart] = []
    for view in estimate.views:
        try:
            drawn.append(Chart(view.name, view.note, fit_figure(view, estimate, truth)))
        except Exception as error:
            # A failed chart must not cost the page.
            parameter, kind = estimate.parameter, type(error).__name__
            log.warning("no chart of %s: %s: %s", parameter, kind, error)
    return tuple(drawn)


def fit_figure(view: FitView, estimate: Estimate, truth: Truth | None) -> Figure:
    """Make the figure of `view`.

    It shows the predictions with the estimate's interval, the truth if it is known, and the
    measured values. Where error bars are too small to be seen, residuals are shown below.
    """
    # Residuals get their own axis if the predictions span many standard deviations.
    std = np.broadcast_to(np.asarray(view.std, float), view.x.shape)
    stated = float(np.median(std))
    residuals = stated > 0.0 and float(np.nanmax(view.predicted) - np.nanmin(view.predicted)) > (
        BARELY_SEEN * stated
    )
    # Collect the values that the vertical axis must include; very uncertain ones may exceed it.
    shown = [view.measured, view.predicted]
    certain = std <= WIDE * stated
    shown += [(view.measured + sign * std)[certain] for sign in (-1.0, 1.0)]
    data = list(prediction_traces(view, estimate, truth, shown))
    data += measured_traces(view, std, view.measured, "y")
    layout: Figure = {
        "height": TALL if residuals else SHORT,
        "margin": {"l": 58, "r": 14, "t": 40, "b": 44},
        "hovermode": "closest",
        "dragmode": "zoom",
        "legend": {**LEGEND, "traceorder": "normal"},
        "xaxis": {
            "title": {"text": escape(view.axes[0])},
            "anchor": "y2" if residuals else "y",
            "range": axis_range(view.x, 0.04),
            "zeroline": False,
        },
        "yaxis": {
            "title": {"text": escape(view.axes[1]), "standoff": 6},
            "automargin": True,
            "domain": (0.42, 1.0) if residuals else (0.0, 1.0),
            "range": axis_range(np.concatenate(shown), 0.08),
            "zeroline": False,
        },
    }
    if residuals:
        # A second axis below, on the same abscissa.
        left = view.measured - view.predicted
        data += [{**trace, "showlegend": False} for trace in measured_traces(view, std, left, "y2")]
        near = np.concatenate([(left - std)[certain], (left + std)[certain], left, [0.0]])
        layout["yaxis2"] = {
            "title": {"text": "residual", "standoff": 6},
            "automargin": True,
            "domain": (0.0, 0.34),
            "range": axis_range(near, 0.1),
        }
    return {"data": data, "layout": layout}


def axis_range(values: Array, air: float) -> tuple[float, float]:
    axis = Axis.enclose(values[np.isfinite(values)], air)
    return axis.low, axis.high


def prediction_traces(
    view: FitView, estimate: Estimate, truth: Truth | None, shown: list[Array]
) -> Iterator[Figure]:
    """Yield the predicted curve.

    If the view has slopes, ∂prediction/∂value, the curve has its 95 % interval and the truth.
    Values that the axis must include are added to `shown`.
    """
    name = "the fit"
    # Sort by x for a line; rows without x cannot be drawn.
    order = np.argsort(view.x, kind="stable")
    order = order[np.isfinite(view.x[order])]
    # 400 points suffice for a smooth curve.
    order = order[np.unique(np.linspace(0, len(order) - 1, 400).astype(int))]
    x, predicted = view.x[order], view.predicted[order]
    if view.slopes is not None:
        slopes = view.slopes[order]
        if len(estimate.values) == 1:
            # The text of the card: one value has one text.
            (figure,) = figures(estimate)
            name = with_unit(f"the fit, {figure.value} ± {figure.std}", estimate.unit)
            # The interval of a single component may be skewed, e.g. that of a stiffness.
            low, high = (estimate.intervals[0] - estimate.values[0]).tolist()
            ends = predicted + low * slopes[:, 0], predicted + high * slopes[:, 0]
        else:
            # Independent components: σ² = Σ (slope σ)².
            half = Z95 * np.sqrt(slopes**2 @ estimate.stds**2)
            ends = predicted - half, predicted + half
        shown += ends
        # Two invisible edges, the area between them filled.
        edge: dict[str, Any] = {"line": {"width": 0}, "hoverinfo": "skip"}
        yield _curve("", x, ends[0], showlegend=False, **edge)
        yield _curve("its 95 % interval", x, ends[1], fill="tonexty", fillcolor=BAND, **edge)
    yield _curve(name, x, predicted, line={"color": MARK, "width": 2.4})
    # Linearize: the true curve is the prediction plus slope times the error of the estimate.
    if truth and view.slopes is not None:
        true = predicted + view.slopes[order] @ (np.array(truth) - estimate.values)
        shown.append(true)
        yield _curve("the truth", x, true, line={"color": TRUTH, "width": 2, "dash": "dash"})


def measured_traces(view: FitView, std: Array, values: Array, axis: str) -> Iterator[Figure]:
    """Measured values, or their residuals, group by group: points with error bars, or a curve."""
    # Rows that the fit used, and the group of each row.
    used = np.ones(len(view.x), dtype=bool) if view.used is None else view.used
    # Draw each group in its colour. Dense rows without deviations become a line, all others points.
    groups = [view.groups] * len(view.x) if isinstance(view.groups, str) else view.groups
    for colour, group in zip(COLOURS, dict.fromkeys(groups), strict=False):
        rows = np.array([member == group for member in groups])
        if rows.sum() > MANY and not std[rows].any():
            yield _line(group, view.x[rows], values[rows], axis, NORM, 1.2)
            if not used[rows].all():
                kept = np.where(used[rows], values[rows], np.nan)
                yield _line(f"{group}, used", view.x[rows], kept, axis, "#3b82f6", 2.0)
            continue
        for name, of, tint in ((group, rows & used, colour), ("not used", rows & ~used, FAINT)):
            if of.any():
                spread = f"{name}, ± 1 std" if std[of].any() else name
                yield _dots(spread, view.x[of], values[of], std[of], axis, tint)


def _curve(name: str, x: Array, y: Array, **more: Any) -> Figure:
    return scatter(escape(name), x, y, **({"hovertemplate": "%{x:.4g}: %{y:.4g}"} | more))


def _line(name: str, x: Array, y: Array, axis: str, colour: str, width: float) -> Figure:
    x, y = decimate(x, y)
    return _curve(name, x, y, yaxis=axis, line={"color": colour, "width": width})


def _dots(name: str, x: Array, y: Array, std: NDArray[Any], axis: str, colour: str) -> Figure:
    bars = {"type": "data", "array": pack_array(std), "width": 0, "thickness": 1, "color": colour}
    style: dict[str, Any] = {"mode": "markers", "marker": {"color": colour, "size": 7}}
    if std.any():
        style["error_y"] = bars
    return _curve(name, x, y, yaxis=axis, **style)
