"""Charts of an inertia: torque of the load in each joint, swing by swing, against one rigid body."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.estimation.load.segments import weighings
from palpate.estimation.swung import Swing, contrast, swings
from palpate.geometry.pose import Array
from palpate.report.data import Measured
from palpate.report.evidence.chart import Chart, Sheet, span
from palpate.trace.samples import Trace

FASTER = 1.2
"""Times the slowest rate: what is called a fast swing."""
DOTS = (("up", "slow swings, ± 1 std"), ("rest", "fast swings, ± 1 std"))
Told = tuple[Swing, Array, Array]
"""A swing with the load, (m,) what the load adds to the joints' torques, N m, and its variance."""


def swung_charts(measured: Measured, trace: Trace) -> tuple[Chart, ...]:
    """All swings in one chart, and what one body leaves of them."""
    told = list(_told(measured, trace))
    if not told:
        return ()
    load = np.concatenate([swing.load for swing, _, _ in told])
    observed = np.concatenate([added for _, added, _ in told])
    std = np.sqrt(np.concatenate([variance for _, _, variance in told]))
    # Least squares by one body in the hand's axes; what swings do not excite stays 0.
    body = np.linalg.lstsq(load / std[:, None], observed / std, rcond=1e-6)[0]
    rates = np.concatenate([np.full(len(added), swing.rate) for swing, added, _ in told])
    points = _Points(1e3 * (load @ body), 1e3 * observed, 1e3 * std, rates > FASTER * rates.min())
    return _agreement(points, told), _residuals(points)


def _told(measured: Measured, trace: Trace) -> Iterator[Told]:
    evidence = measured.estimate.evidence
    swung = [one for one in trace.recordings if one.context.activity == "swinging"]
    if not evidence or not swung:
        return
    noise = weighings(trace, evidence[0])[0].noise
    empty = [one for r in swung if r.context.holding is None for one in swings(trace, r, noise)]
    for recording in swung:
        if recording.context.holding == measured.estimate.parameter.object:
            yield from contrast(swings(trace, recording, noise), empty)


@dataclass(frozen=True, slots=True, eq=False)
class _Points:
    """Points, one per swing and joint: (n,) mN·m predicted by one rigid body, observed, and
    standard deviation; fast swing or not."""

    made: Array
    observed: Array
    std: Array
    fast: NDArray[np.bool_]

    def draw(self, sheet: Sheet, up: Array) -> None:
        """Their dots at heights `up`."""
        rows = zip(
            self.made.tolist(), up.tolist(), self.std.tolist(), self.fast.tolist(), strict=True
        )
        for across, height, std, fast in rows:
            sheet.dot("rest" if fast else "up", across, height, std)


def _agreement(points: _Points, told: list[Told]) -> Chart:
    sheet = Sheet(
        span(points.made, 0.08), span(np.concatenate([points.observed, points.made]), 0.08)
    )
    ends = np.array(sheet.x)
    sheet.line("fit", ends, ends)
    points.draw(sheet, points.observed)
    rates = sorted({round(swing.rate / (2.0 * np.pi), 1) for swing, _, _ in told})
    hertz = " and ".join(f"{rate:.1f}" for rate in rates)
    return sheet.chart(
        "What the load adds to the joints' torques as the hand swings.",
        f"{len(told)} swings at {hertz} Hz, less the same swings of the empty hand; a dot for each joint. On the line, "
        "what was felt is what one rigid body makes.",
        ("by one rigid body (mN·m)", "as felt (mN·m)"),
        (*DOTS, ("fit", "where both agree")),
    )


def _residuals(points: _Points) -> Chart:
    left = points.observed - points.made
    ends = np.concatenate([left - points.std, left + points.std])
    sheet = Sheet(span(points.made, 0.08), span(ends, 0.1))
    sheet.level("fit", 0.0)
    points.draw(sheet, left)
    rms = float(np.sqrt(np.mean(left**2)))
    return sheet.chart(
        "What one rigid body leaves of them.",
        f"{rms:.2f} mN·m (root mean square), of up to {np.abs(points.observed).max():.0f} mN·m. The estimate also "
        "knows how the object hangs, and that what is between pads and object gives way, more so in fast swings.",
        ("by one rigid body (mN·m)", "left of it (mN·m)"),
        DOTS,
    )
