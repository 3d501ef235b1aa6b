"""The loading curve of a guarded descent: tip height over pressing force.

Touching has three stages: free air, perhaps something soft that gives way while the force rises
slowly, then the rigid surface, on which the tip stops although it is told to go on. Only there are
force and tip height taken; where the force varies enough to show how the surface yields, the line
through them is carried back to the force at which the stiff part began.

                 tip height
                     |  free air   |   soft   | stiff
                     |-------------.
                     |              `-._
                     |                  `-.___________  slope: compliance
                     +-------------------------------> force
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.windows import Mask
from palpate.geometry.pose import Array
from palpate.trace.recording import Hand, LeafRun, Recording
from palpate.trace.samples import Samples, Trace

GUARDED = "MoveUntilContact"
"""The primitive whose leaf is a guarded descent."""


@dataclass(frozen=True, slots=True, eq=False)
class Stiff:
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

    @property
    def rigid(self) -> bool:
        """Whether it gives way so little that it is a rigid surface."""
        return self.compliance < tuning.RIGID


@dataclass(frozen=True, slots=True, eq=False)
class Touch:
    """What a guarded descent met.

    Attributes:
        stiff: the stiff part of its loading curve.
        soft: world z, m, at which the force began to rise, where that was well above the rigid
            surface.
        full: N, the force while the pose was recorded.
    """

    stiff: Stiff
    soft: float | None
    full: float


@dataclass(frozen=True, slots=True, eq=False)
class Descent:
    """Samples from a guarded descent to the retreat after its recording.

    Attributes:
        samples: of the whole motion. leaf: the descent itself.
        z: (n,) m, tip height. force: (n,) N, pressing down. noise: N, of a row's force in free air.
        pressed: rows of the recording.
    """

    samples: Samples
    leaf: LeafRun
    z: Array
    force: Array
    noise: float
    pressed: Mask

    @property
    def told(self) -> Array:
        """(n,) m/s, commanded downward speed."""
        return -np.gradient(self.samples.target_world_tcp[:, 2], self.samples.t)

    @property
    def on_the_way(self) -> Mask:
        """Rows of the descent."""
        return self.samples.t <= self.leaf.end

    @property
    def cruising(self) -> Mask:
        """Rows of the descent at its full speed."""
        return _cruising(self.samples, self.leaf)

    @property
    def slow(self) -> Mask:
        """Rows where the tip hardly moves, measured by the speed of the descent."""
        speed = float(np.abs(self.told)[self.on_the_way].max(initial=1e-6))
        return np.abs(self.samples.twist[:, 2]) < tuning.STOPPED * speed

    @property
    def full(self) -> float:
        """N, the force while the pose was recorded."""
        return float(np.median(self.force[self.pressed]))

    @property
    def least(self) -> float:
        """N: from this force on, the curve is contact and not noise."""
        return max(tuning.TOUCH * self.full, tuning.CONTACT_NOISE * self.noise)


def tip_height(samples: Samples, hand: Hand) -> Array:
    """(n,) world z of the lower fingertip, m.

    Seen from the side the hand is a T: from the TCP the tips lie `tip_offset` along the tool axis
    z, and half the opening to either side along the closing direction y. When the hand leans over
    in that direction, one tip is lower than the other by the opening times the sine of the lean,
    and that one touches first. Rotation matrix from a quaternion wxyz: R[2,2] = 1 - 2 (x² + y²),
    R[2,1] = 2 (y z + w x).
    """
    w, x, y, z = samples.pose_world_tcp[:, 3:].T
    tool_z = 1.0 - 2.0 * (x**2 + y**2)
    closing_z = 2.0 * (y * z + w * x)
    middle = samples.pose_world_tcp[:, 2] + hand.tip_offset * tool_z
    return middle - samples.width / 2 * np.abs(closing_z)


def touched(trace: Trace, recording: Recording) -> Touch:
    """What the guarded descent before a recorded pose met.

    Raises:
        ValueError: the recording holds no samples, or no guarded descent comes before it.
    """
    descent = _descent(trace, recording)
    stop = _stop(descent)
    if stop is None:
        stiff = _yielding(descent)
    else:
        below = descent.z < float(descent.z[descent.pressed].mean()) + tuning.LIFT_OFF
        touching = below | descent.pressed
        stiff = _stiff(descent, touching & (descent.samples.t >= stop) & descent.slow)
    return Touch(stiff, _soft_onset(descent, stiff.height), descent.full)


def _descent(trace: Trace, recording: Recording) -> Descent:
    leaves = trace.leaf_runs(GUARDED)
    before = [leaf for leaf in leaves if leaf.end <= recording.start + 1e-6]
    if not before:
        raise ValueError(
            "no guarded descent (MoveUntilContact) comes before the recording of the pose"
        )
    leaf = before[-1]
    samples = trace.samples.between(leaf.start, recording.end + tuning.RETREAT)
    pressed = (samples.t >= recording.start) & (samples.t <= recording.end)
    if not pressed.any():
        raise ValueError("the recording of the pose holds no samples")
    force, noise = _pressing(samples, leaf)
    return Descent(samples, leaf, tip_height(samples, trace.hand), force, noise, pressed)


def _cruising(samples: Samples, leaf: LeafRun) -> Mask:
    told = -np.gradient(samples.target_world_tcp[:, 2], samples.t)
    within = samples.t <= leaf.end
    return within & (told > tuning.DESCENDING * float(told[within].max(initial=1e-6)))


def _pressing(samples: Samples, leaf: LeafRun) -> tuple[Array, float]:
    """(n,) N, downward force less what was felt in free air early in the descent; and the noise of
    a row."""
    down = -samples.wrench[:, 2]
    descent = np.flatnonzero(_cruising(samples, leaf))
    early = descent[: max(5, len(descent) // 3)]
    if not len(early):
        return down - down[0], 0.0
    return down - np.median(down[early]), float(down[early].std())


def _stop(descent: Descent) -> float | None:
    """Time at which the tip stopped although it was told to go on; None when it only stopped when
    told to."""
    told, slow = descent.told, descent.slow
    descending = descent.cruising & ~slow
    began = np.flatnonzero(descending)
    if not len(began):
        return None
    going_on = told > tuning.HALTED * float(told[descending].max())
    halted = slow & going_on & descent.on_the_way
    after = np.flatnonzero(halted[began[0] :])
    if not len(after):
        return None
    return float(descent.samples.t[began[0] + after[0]])


def _stiff(descent: Descent, rows: Mask) -> Stiff:
    """The longest straight part among `rows`, on a rigid surface; where the force hardly varies,
    what was held."""
    rising = descent.force[rows & (descent.force > descent.least)]
    span = float(np.ptp(np.percentile(rising, [3, 97]))) if len(rising) else 0.0
    lines = list(_lines(descent, rows))
    if span < max(tuning.SPAN * descent.full, tuning.SPAN_NOISE * descent.noise) or not lines:
        held = descent.z[descent.pressed]
        return Stiff(float(np.median(held)), 0.0, 0.0, max(float(held.std()), tuning.UNSEEN))
    for stiff, rms in lines:
        if rms < tuning.STRAIGHT:
            return stiff
    # None is straight: the last begins at the highest force, where the surface is stiffest.
    return lines[-1][0]


def _lines(descent: Descent, rows: Mask) -> Iterator[tuple[Stiff, float]]:
    """Lines through the curve above each knee, the longest first, with their rms residuals, m."""
    for part in tuning.KNEES:
        knee = max(part * descent.full, descent.least)
        line = _line(descent.z, descent.force, rows & (descent.force > knee), knee)
        if line is not None:
            yield line


def _yielding(descent: Descent) -> Stiff:
    """The whole curve's line: nothing stiff was met."""
    line = _line(descent.z, descent.force, descent.force > descent.least, 0.0)
    if line is not None and line[0].compliance > tuning.RIGID:
        return line[0]
    held = float(np.median(descent.z[descent.pressed]))
    return Stiff(held, tuning.RIGID, 0.0, line[0].scatter if line else 0.0)


def _line(z: Array, force: Array, rows: Mask, knee: float) -> tuple[Stiff, float] | None:
    """The line z(f) through `rows`, every force interval weighing the same, and its rms residual,
    m.

    Weighted least squares, each row weighing one over how many share its interval of force: the
    tip rests long at the full force, and those rows would else outweigh all others.
    """
    if rows.sum() < tuning.CURVE_ROWS or np.ptp(force[rows]) <= 0.0:
        return None
    f, height = force[rows], z[rows]
    counts, edges = np.histogram(f, bins=tuning.INTERVALS)
    interval = np.clip(np.digitize(f, edges) - 1, 0, tuning.INTERVALS - 1)
    weight = 1.0 / np.sqrt(counts[interval])
    slope, intercept = np.polyfit(f, height, 1, w=weight)
    residual = height - (slope * f + intercept)
    rms = float(np.sqrt(np.average(residual**2, weights=weight**2)))
    # A curve that is straight from the first touch on began at no force at all.
    begin = 0.0 if knee <= tuning.TOUCH * float(f.max()) else knee
    scatter = float(rms / np.sqrt(np.count_nonzero(counts)))
    compliance = max(-float(slope), 0.0)
    return Stiff(float(slope * begin + intercept), compliance, begin, scatter), rms


def _soft_onset(descent: Descent, rigid: float) -> float | None:
    """World z where the force began to rise for good, when that was well above the rigid surface.

    A rise shows late in the noise, so it is carried back to no force at all.
    """
    z, force, rows = descent.z, descent.force, tuning.SOFT_SMOOTH
    smooth = np.convolve(force, np.ones(rows) / rows, mode="same")
    nothing = max(tuning.SOFT_FORCE, tuning.CONTACT_NOISE * descent.noise / np.sqrt(rows))
    quiet = np.flatnonzero(descent.on_the_way & (smooth < nothing))
    if not len(quiet) or z[quiet[-1]] < rigid + tuning.SOFT:
        return None
    seen = float(z[quiet[-1]])
    rise = descent.on_the_way & (z < seen) & (z > rigid + tuning.SOFT_RISE * (seen - rigid))
    if rise.sum() < tuning.CURVE_ROWS:
        return seen
    slope, onset = np.polyfit(force[rise], z[rise], 1)
    if slope >= 0.0:
        return seen
    return float(np.clip(onset, seen, seen + (seen - rigid)))
