"""Chart of a fit: measured values with error bars, and the fit's predictions."""

from __future__ import annotations

import numpy as np

from palpate.estimation.view import FitView
from palpate.report.data import Measured
from palpate.report.evidence.chart import Chart, Sheet, span
from palpate.report.numbers import with_spread

STYLES = ("up", "rest", "down")
"""Dots of the first, second and third group of points."""
MANY = 60
"""More points than this of one group are drawn as a line."""
WIDE = 4.0
"""Times the median standard deviation: wider error bars do not stretch the axis."""


def fit_chart(view: FitView, measured: Measured) -> Chart:
    """The chart of `view`, one of the fits behind an estimate."""
    sheet = Sheet(span(view.x, 0.05), span(_shown(view, measured), 0.1))
    legend = _prediction(sheet, view, measured)
    for start, end in view.windows:
        sheet.band("loaded", (start, end))
    if view.windows:
        legend.append(("loaded", "samples used"))
    for style, group in zip(STYLES, dict.fromkeys(view.groups), strict=False):
        rows = np.flatnonzero([one == group for one in view.groups])
        if len(rows) > MANY:
            order = rows[np.argsort(view.x[rows])]
            sheet.line("felt", view.x[order], view.measured[order])
            legend.append(("line", group))
            continue
        for x, y, std in zip(view.x[rows], view.measured[rows], view.std[rows], strict=True):
            sheet.dot(style, float(x), float(y), float(std))
        legend.append((style, f"{group}, ± 1 std" if view.std[rows].any() else group))
    return sheet.chart(view.name, view.note, view.axes, legend)


def _shown(view: FitView, measured: Measured) -> np.ndarray:
    """Values that the axis holds."""
    certain = view.std <= WIDE * np.median(view.std)
    near, std = view.measured[certain], view.std[certain]
    ends = [near - std, near + std, view.measured, view.predicted]
    if view.component is not None:
        ends.append(view.scale * measured.estimate.intervals[view.component])
    return np.concatenate(ends)


def _prediction(sheet: Sheet, view: FitView, measured: Measured) -> list[tuple[str, str]]:
    """Draw the fit; where it is a component of the estimate, with its interval and the truth."""
    if view.component is None:
        order = np.argsort(view.x, kind="stable")
        sheet.line("fit", view.x[order], view.predicted[order])
        return [("fit", "the fit")]
    estimate, i = measured.estimate, view.component
    low, high = (view.scale * estimate.intervals[i]).tolist()
    value, std = float(estimate.values[i]), float(estimate.stds[i])
    sheet.band("interval", sheet.x, (low, high))
    sheet.level("fit", view.scale * value)
    unit = "" if estimate.unit == "1" else estimate.unit
    legend = [
        ("fit", f"the estimate, {with_spread(value, std, unit)}"),
        ("interval", "its 95 % interval"),
    ]
    if measured.truth:
        sheet.level("truth", view.scale * measured.truth[i])
        legend.append(("true", "the truth"))
    return legend
