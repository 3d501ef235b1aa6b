"""Charts of a friction: tangential over normal force, for all drags."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.estimation.estimate import rounded
from palpate.estimation.friction.drags import Drag, steady_drags
from palpate.estimation.load.observation import observe
from palpate.report.data import Measured
from palpate.report.evidence.chart import Chart, Sheet, span
from palpate.trace.samples import Trace

BLOCKS = 12
"""Means of each drag that are drawn."""


def slid_charts(measured: Measured, trace: Trace) -> tuple[Chart, ...]:
    """The forces of all drags against each other, and their quotient over time."""
    drags = steady_drags(trace, measured.estimate.parameter.object, observe(trace))
    if not drags:
        return ()
    return _forces(drags, measured), _quotient(drags, measured)


def _forces(drags: Sequence[Drag], measured: Measured) -> Chart:
    value, std = float(measured.estimate.values[0]), float(measured.estimate.stds[0])
    points: list[tuple[float, float]] = []
    for drag in drags:
        rows = np.flatnonzero(drag.cruising & drag.moving)
        for block in np.array_split(rows, BLOCKS) if len(rows) else ():
            if len(block):
                points.append(
                    (float(drag.normal[block].mean()), float(drag.tangential[block].mean()))
                )
    normal, tangential = (np.array(axis) for axis in zip(*points, strict=True))
    right = 1.05 * float(normal.max())
    sheet = Sheet((0.0, right), span(np.array([0.0, *tangential, value * right]), 0.06))
    sheet.line("fit", np.array([0.0, right]), np.array([0.0, value * right]))
    if measured.truth:
        sheet.line("truth", np.array([0.0, right]), np.array([0.0, measured.truth[0] * right]))
    for place, force in points:
        sheet.dot("up", place, force)
    shown, spread = rounded(value, std)
    sheet.note("fit", 0.3 * right, value * 0.42 * right, f"slope {shown} ± {spread}")
    slope, rest = np.polyfit(normal, tangential, 1).tolist()
    return sheet.chart(
        "Force along the drag over the force that presses.",
        f"{len(points)} means of {len(drags)} drags, each less what was felt of the object hanging free. A straight "
        f"line through the dots has the slope {slope:.3f} and leaves {rest:.2f} N where nothing presses: what the "
        "joints rub. The estimate also knows which way each joint was turned.",
        ("pressing (N)", "along the drag (N)"),
        _legend(measured, ("up", "a stretch of a drag, sliding steadily")),
    )


def _quotient(drags: Sequence[Drag], measured: Measured) -> Chart:
    value = float(measured.estimate.values[0])
    start, end = drags[0].t[0], drags[-1].t[-1]
    static = measured.estimate.parts.get("static")
    tops = [value, *(float(np.percentile(drag.quotient, 99.5)) for drag in drags)]
    sheet = Sheet((float(start), float(end)), span(np.array([0.0, *tops]), 0.12))
    low, high = measured.estimate.intervals[0].tolist()
    for drag in drags:
        rows = np.flatnonzero(drag.cruising & drag.moving)
        if len(rows):
            sheet.band("loaded", (float(drag.t[rows[0]]), float(drag.t[rows[-1]])))
        sheet.line("felt", drag.t, drag.quotient)
        begun = drag.breakaway
        if begun is not None:
            sheet.dot("down", float(drag.t[begun]), float(drag.quotient[begun]))
    sheet.band("interval", sheet.x, (low, high))
    sheet.level("fit", value)
    if measured.truth:
        sheet.level("truth", measured.truth[0])
    said = "Its forces in each drag, one over the other: it sticks, breaks away and slides."
    if static is not None:
        pair = " ± ".join(rounded(static.value, static.std))
        said += f" Static, of the breakaways: {pair}."
    more = (("loaded", "sliding steadily"), ("down", "breakaway"), ("line", "as felt, smoothed"))
    return sheet.chart(
        "The quotient over time.",
        said,
        ("robot time (s)", "along / pressing"),
        _legend(measured, *more),
    )


def _legend(measured: Measured, *more: tuple[str, str]) -> list[tuple[str, str]]:
    found = [("fit", "the estimate"), *more]
    if measured.truth:
        found.append(("true", "the truth"))
    return found
