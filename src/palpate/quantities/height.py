"""Height of what is rigid under the fingertips, from a guarded descent.

Touching is a loading curve: free air, perhaps something soft that gives way while the force rises
slowly, then the rigid surface, on which the tip stops although it is told to go on. Only there are
force and tip height taken; where the force varies enough to show how the surface yields, the line
through them is carried back to the force at which the stiff part began.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.estimation.estimate import Estimate
from palpate.estimation.windows import Mask
from palpate.geometry.pose import Array
from palpate.parameter import Parameter
from palpate.trace.recording import Conversion, Hand, LeafRun, Recording
from palpate.trace.samples import Samples, Trace

GUARDED = "MoveUntilContact"

STOPPED = 0.3
"""Part of the approach speed below which the tip counts as stopped by something much stiffer than
the arm."""

TOUCH = 0.15
"""Part of the pressing force from which the curve is trusted to be contact and not noise."""

KNEES = (TOUCH, 0.3, 0.45, 0.6, 0.75)
"""Parts of the pressing force at which the stiff part may begin."""

SPAN = 0.25
"""Part of the pressing force by which it must rise while the tip stands for the surface to be
stiff."""

MIN_ROWS = 5
INTERVALS = 8

HALTED = 0.5
"""Part of the descent's speed that must still be commanded for a stop to be the surface's doing."""

LIFT_OFF = 0.002
"""m above where it was held: there the tip has left the surface."""

UNSEEN = 2e-5
"""m (1 sigma): penetration of a rigid surface where the force did not vary enough to see it."""

STRAIGHT = 5e-5
"""m: largest residual (rms) of the stiff part about its line."""

RIGID = 2e-4
"""m/N: what gives way more than this is not a rigid surface."""

SOFT = 0.0015
"""m above the rigid surface from which an earlier rise of the force is something soft."""

SOFT_ACCURACY = 2e-3
"""m (1 sigma): what is soft has no sharp beginning."""

RETREAT = 1.5
"""s after the recording in which the unloading curve is looked for."""

CORRECTION = 0.25
"""1 sigma, relative, of the correction for penetration: contacts are not quite linear."""


@dataclass(frozen=True, slots=True, eq=False)
class _Stiff:
    """The stiff part of a loading curve.

    Attributes:
        height: m, of the line at `knee`. compliance: m/N. knee: N, force at which the stiff part
            begins.
        scatter: m, standard error of `height`.
    """

    height: float
    compliance: float
    knee: float
    scatter: float


def estimate_height(trace: Trace, conversion: Conversion) -> Estimate:
    """World z of the rigid surface under the fingertips, m.

    `components`: `penetration` (m, how far the pressed tip was below it) and, when the force began
    to rise earlier, `soft onset` (world z, m). A surface that still gives way under the full force
    is `prior-dominated`.

    Raises:
        ValueError: the recording holds no samples, or no guarded descent comes before it.
    """
    recording = conversion.recording
    samples, leaf = _touch(trace, recording)
    z = tip_height(samples, trace.hand)
    force, noise = _pressing(samples, leaf)
    pressed = (samples.t >= recording.start) & (samples.t <= recording.end)
    if not pressed.any():
        raise ValueError(f"the recording of {conversion.object} holds no samples")
    touching = ~pressed & (z < float(z[pressed].mean()) + LIFT_OFF) | pressed
    curve = _Curve(z, force, noise, float(np.median(force[pressed])), pressed)
    stop = _stop(samples, leaf)
    stiff = (
        curve.stiff(touching & (samples.t >= stop) & _slow(samples, leaf))
        if stop is not None
        else curve.soft()
    )
    soft = _soft_onset(z, force, noise, samples.t <= leaf.end, stiff.height)
    return _estimate(conversion, stiff, soft, curve.full, trace.hand)


def tip_height(samples: Samples, hand: Hand) -> Array:
    """(n,) world z of the lower fingertip, m: the tips lie `tip_offset` beyond the TCP, apart by
    the width."""
    w, x, y, z = samples.pose_world_tcp[:, 3:].T
    tool_z = 1.0 - 2.0 * (x**2 + y**2)
    closing_z = 2.0 * (y * z + w * x)
    return (
        samples.pose_world_tcp[:, 2]
        + hand.tip_offset * tool_z
        - samples.width / 2 * np.abs(closing_z)
    )


def _touch(trace: Trace, recording: Recording) -> tuple[Samples, LeafRun]:
    """The samples from the guarded descent to the retreat, and the descent."""
    before = [leaf for leaf in trace.leaf_runs(GUARDED) if leaf.end <= recording.start + 1e-6]
    if not before:
        raise ValueError(
            "no guarded descent (MoveUntilContact) comes before the recording of the pose"
        )
    return trace.samples.between(before[-1].start, recording.end + RETREAT), before[-1]


def _pressing(samples: Samples, leaf: LeafRun) -> tuple[Array, float]:
    """(n,) N, downward force less what was felt in free air early in the descent; and the noise of
    a row."""
    down = -samples.wrench[:, 2]
    descent = np.flatnonzero(_cruising(samples, leaf))
    early = descent[: max(5, len(descent) // 3)]
    if not len(early):
        return down - down[0], 0.0
    return down - np.median(down[early]), float(down[early].std())


def _speed(samples: Samples) -> Array:
    return np.gradient(samples.target_world_tcp[:, 2], samples.t)


def _cruising(samples: Samples, leaf: LeafRun) -> Mask:
    speed = -_speed(samples)
    within = samples.t <= leaf.end
    return within & (speed > 0.9 * float(speed[within].max(initial=1e-6)))


def _slow(samples: Samples, leaf: LeafRun) -> Mask:
    """Rows where the tip hardly moves, measured by the speed of the descent."""
    descent = float(np.abs(_speed(samples))[samples.t <= leaf.end].max(initial=1e-6))
    return np.abs(samples.twist[:, 2]) < STOPPED * descent


def _stop(samples: Samples, leaf: LeafRun) -> float | None:
    """Time at which the tip stopped although it was told to go on; None when it only stopped when
    told to."""
    told = -_speed(samples)
    descending = _cruising(samples, leaf) & ~_slow(samples, leaf)
    began = np.flatnonzero(descending)
    if not len(began):
        return None
    halted = (
        _slow(samples, leaf)
        & (told > HALTED * float(told[descending].max()))
        & (samples.t <= leaf.end)
    )
    after = np.flatnonzero(halted[began[0] :])
    return float(samples.t[began[0] + after[0]]) if len(after) else None


@dataclass(frozen=True, slots=True, eq=False)
class _Curve:
    """A loading curve: (n,) tip height (m) and force (N), the force's noise, the full force, and
    where it was held."""

    z: Array
    force: Array
    noise: float
    full: float
    pressed: Mask

    def stiff(self, rows: Mask) -> _Stiff:
        """The longest straight part among `rows`, on a rigid surface; where the force hardly
        varies, what was held."""
        least = max(TOUCH * self.full, 4.0 * self.noise)
        rising = self.force[rows & (self.force > least)]
        span = float(np.ptp(np.percentile(rising, [3, 97]))) if len(rising) else 0.0
        if span < max(SPAN * self.full, 6.0 * self.noise):
            held = self.z[self.pressed]
            return _Stiff(float(np.median(held)), 0.0, 0.0, max(float(held.std()), UNSEEN))
        knees = [max(part * self.full, least) for part in KNEES]
        lines = [_line(self.z, self.force, rows & (self.force > knee), knee) for knee in knees]
        possible = [line for line in lines if line is not None]
        straight = [stiff for stiff, rms in possible if rms < STRAIGHT]
        return straight[0] if straight else possible[-1][0]

    def soft(self) -> _Stiff:
        """The whole curve's line: nothing stiff was met."""
        least = max(TOUCH * self.full, 4.0 * self.noise)
        line = _line(self.z, self.force, self.force > least, 0.0)
        held = float(np.median(self.z[self.pressed]))
        stiff = line[0] if line else _Stiff(held, RIGID, 0.0, 0.0)
        return stiff if stiff.compliance > RIGID else _Stiff(held, RIGID, 0.0, stiff.scatter)


def _line(z: Array, force: Array, rows: Mask, knee: float) -> tuple[_Stiff, float] | None:
    """The line z(f) through `rows`, every force interval weighing the same, and its rms residual,
    m."""
    if rows.sum() < MIN_ROWS or np.ptp(force[rows]) <= 0.0:
        return None
    f, height = force[rows], z[rows]
    counts, edges = np.histogram(f, bins=INTERVALS)
    bins = np.clip(np.digitize(f, edges) - 1, 0, INTERVALS - 1)
    weight = 1.0 / np.sqrt(counts[bins])
    slope, intercept = np.polyfit(f, height, 1, w=weight)
    rms = float(np.sqrt(np.average((height - (slope * f + intercept)) ** 2, weights=weight**2)))
    begin = 0.0 if knee <= TOUCH * float(f.max()) else knee
    scatter = rms / np.sqrt(np.count_nonzero(counts))
    return _Stiff(
        float(slope * begin + intercept), max(-float(slope), 0.0), begin, float(scatter)
    ), rms


def _soft_onset(z: Array, force: Array, noise: float, approach: Mask, rigid: float) -> float | None:
    """World z where the force began to rise for good, when that was well above the rigid surface.

    A rise shows late in the noise, so it is carried back to no force at all.
    """
    smooth = np.convolve(force, np.ones(7) / 7, mode="same")
    quiet = np.flatnonzero(approach & (smooth < max(0.15, 4.0 * noise / np.sqrt(7))))
    if not len(quiet) or z[quiet[-1]] < rigid + SOFT:
        return None
    seen = float(z[quiet[-1]])
    rise = approach & (z < seen) & (z > rigid + 0.5 * (seen - rigid))
    if rise.sum() < MIN_ROWS:
        return seen
    slope, onset = np.polyfit(force[rise], z[rise], 1)
    return float(np.clip(onset, seen, seen + (seen - rigid))) if slope < 0.0 else seen


def _estimate(
    conversion: Conversion, stiff: _Stiff, soft: float | None, full: float, hand: Hand
) -> Estimate:
    penetration = stiff.compliance * max(full - stiff.knee, 0.0)
    std = float(
        np.sqrt(
            hand.pose_repeatability**2
            + stiff.scatter**2
            + (CORRECTION * penetration) ** 2
            + (stiff.compliance * hand.force_repeatability) ** 2
        )
    )
    rigid = stiff.compliance < RIGID
    if not rigid:
        std = max(std, stiff.compliance * full)
    components = {"penetration": (penetration, CORRECTION * penetration)}
    if soft is not None:
        components["soft onset"] = (soft, SOFT_ACCURACY)
    return Estimate(
        Parameter(conversion.object, "height"),
        (stiff.height,),
        (std,),
        ((stiff.height - 1.96 * std, stiff.height + 1.96 * std),),
        _method(stiff, soft, full),
        (conversion.recording,),
        "identified" if rigid else "prior-dominated",
        components,
    )


def _method(stiff: _Stiff, soft: float | None, full: float) -> str:
    text = (
        f"Height of the fingertips where the descent was stopped, carried back along the loading curve "
        f"({1e6 * stiff.compliance:.0f} µm/N, pressed with {full:.1f} N) to its beginning"
    )
    if stiff.compliance >= RIGID:
        return text + "; it still gives way under the full force, so nothing rigid was reached."
    if soft is not None:
        return (
            text
            + f"; something soft above it, {1e3 * (soft - stiff.height):.0f} mm thick, was pressed through."
        )
    return text + "."
