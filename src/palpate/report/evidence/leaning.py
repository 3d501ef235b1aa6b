"""Chart of a tilt: heights of the touches over the uphill direction."""

from __future__ import annotations

import numpy as np

from palpate.estimation.contact.touch import touches_of
from palpate.report.data import Measured
from palpate.report.evidence.chart import Chart, Sheet, span
from palpate.trace.samples import Trace


def leaned_charts(measured: Measured, trace: Trace) -> tuple[Chart, ...]:
    """Chart seen from the side, along the steepest direction."""
    touches = touches_of(trace, measured.estimate.evidence)
    slope = measured.estimate.values
    steep = float(np.linalg.norm(slope))
    if len(touches) < 3 or steep == 0.0:
        return ()
    uphill = slope / steep
    spots = np.array([touch.spot for touch in touches])
    along = (spots - spots.mean(axis=0)) @ uphill
    heights = np.array([touch.height for touch in touches])
    stds = [1e3 * touch.height_std(trace.hand) for touch in touches]
    level = 1e3 * (heights - heights.mean())
    line = 1e3 * steep * along
    sheet = Sheet(span(1e3 * along, 0.15), span(np.concatenate([level, line]), 0.35))
    ends = np.array(sheet.x)
    sheet.line("fit", ends, steep * ends)
    if measured.truth:
        sheet.line("truth", ends, float(np.dot(measured.truth, uphill)) * ends)
    for place, height, std in zip((1e3 * along).tolist(), level.tolist(), stds, strict=True):
        sheet.dot("up", place, height, std)
    angle = float(np.degrees(np.arctan(steep)))
    sheet.note("fit", 0.0, 0.0, f"{angle:.2f}°")
    worst = float(np.abs(level - line).max())
    heading = float(np.degrees(np.arctan2(uphill[1], uphill[0])))
    legend = [("up", "a touch, ± 1 std"), ("fit", "the estimate")]
    if measured.truth:
        legend.append(("true", "the truth"))
    return (
        sheet.chart(
            f"The {len(touches)} touches, from the side.",
            f"It rises most towards {heading:.0f}° from world x; the plane leaves at most {worst:.2f} mm of a touch.",
            ("along the way uphill (mm)", "height above their mean (mm)"),
            legend,
        ),
    )
