"""Chart of a height: force over height of the fingertips in the descent."""

from __future__ import annotations

import numpy as np

from palpate.estimation.contact.descent import Descent, descent_before
from palpate.estimation.estimate import rounded
from palpate.report.data import Measured
from palpate.report.evidence.chart import Chart, Sheet, span
from palpate.trace.recording import Recording
from palpate.trace.samples import Trace

ABOVE = 0.006
"""m of free air that is shown, unless something soft began higher."""


def touched_charts(measured: Measured, trace: Trace) -> tuple[Chart, ...]:
    """A chart for each touch."""
    found: list[Chart] = []
    for recording in measured.estimate.evidence:
        descent = descent_before(trace, recording)
        if descent is not None:
            found.append(_touch(descent, recording, measured))
    return tuple(found)


def _touch(descent: Descent, recording: Recording, measured: Measured) -> Chart:
    estimate = measured.estimate
    value, std = float(estimate.values[0]), float(estimate.stds[0])
    onset = estimate.parts.get("soft onset")
    began = value if onset is None else max(value, onset.value)
    least = min(float(descent.z.min()), value - 2 * std)
    top = began + max(ABOVE, 0.4 * (began - least))
    rows = descent.z <= top
    height, force = 1e3 * descent.z[rows], descent.force[rows]
    sheet = Sheet(span(np.array([1e3 * least, 1e3 * top]), 0.04), span(force, 0.12))
    sheet.band("interval", (1e3 * (value - 2 * std), 1e3 * (value + 2 * std)))
    sheet.line("felt", height, force)
    pressed = descent.pressed[rows]
    for place, pressing in zip(height[pressed][::20], force[pressed][::20], strict=True):
        sheet.dot("up", float(place), float(pressing))
    low, high = sheet.y
    sheet.line("fit", np.full(2, 1e3 * value), np.array([low, high]))
    if measured.truth:
        sheet.line("truth", np.full(2, 1e3 * measured.truth[0]), np.array([low, high]))
    shown, spread = rounded(1e3 * value, 1e3 * std)
    sheet.note("fit", 1e3 * value, high - 0.1 * (high - low), f"{shown} ± {spread} mm")
    legend = [
        ("line", "pressing force as felt, less that of free air"),
        ("up", "while the pose was recorded"),
        ("fit", "the estimate"),
        ("interval", "± 2 std"),
    ]
    if measured.truth:
        legend.append(("true", "the truth"))
    said = f"The descent stopped with the tips at {1e3 * descent.held:.2f} mm, pressing with {descent.full:.1f} N"
    if onset is not None:
        said += f"; something soft was met at {1e3 * onset.value:.1f} mm and pressed through"
    return sheet.chart(
        f"The touch at {recording.start:.1f} s.",
        f"{said}. Carried back to where it began to bear: the height.",
        ("height of the fingertips (mm)", "force (N)"),
        legend,
    )
