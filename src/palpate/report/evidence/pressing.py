"""Chart of a stiffness: force over depth of both fingertips."""

from __future__ import annotations

import numpy as np

from palpate.estimation.contact.touch import Touch, touches_of
from palpate.estimation.estimate import rounded
from palpate.report.data import Measured
from palpate.report.evidence.chart import Chart, Sheet, span
from palpate.trace.samples import Trace

ABOVE = 0.25
"""Of the depth: so much free air is shown."""


def pressed_charts(measured: Measured, trace: Trace) -> tuple[Chart, ...]:
    """A chart for each press."""
    found: list[Chart] = []
    for touch in touches_of(trace, measured.estimate.evidence):
        found.append(_press(touch, measured))
    return tuple(found)


def _press(touch: Touch, measured: Measured) -> Chart:
    stiffness, std = float(measured.estimate.values[0]), float(measured.estimate.stds[0])
    spring, descent = touch.spring, touch.descent
    depth = 1e3 * (spring.first - descent.z)
    most = float(depth.max())
    rows = depth > -ABOVE * most
    force = descent.force[rows]
    sheet = Sheet((-ABOVE * most, 1.06 * most), span(np.append(force, 0.0), 0.12))
    sheet.line("felt", depth[rows], force)
    ends = np.array([0.0, most])
    sheet.line("fit", ends, 1e-3 * stiffness * ends)
    if measured.truth:
        sheet.line("truth", ends, 1e-3 * measured.truth[0] * ends)
    sheet.dot("up", 1e3 * (spring.first - touch.held), touch.full)
    shown, spread = rounded(stiffness, std)
    sheet.note("fit", 0.4 * most, 0.55e-3 * stiffness * most, f"slope {shown} ± {spread} N/m")
    legend = [
        ("line", "force as felt, less that of free air"),
        ("fit", "the estimate"),
        ("up", "at rest, while the pose was recorded"),
    ]
    if measured.truth:
        legend.append(("true", "the truth"))
    own = 1.0 / spring.compliance if spring.compliance > 0.0 else float("inf")
    return sheet.chart(
        f"The press at {touch.recording.start:.1f} s.",
        f"Both fingertips pressed {most:.2f} mm deep, with {touch.full:.1f} N at rest; this press alone says {own:.0f} "
        "N/m. What moving the arm and its friction take, which the line as felt still has, the estimate takes out.",
        ("depth of the fingertips (mm)", "force (N)"),
        legend,
    )
