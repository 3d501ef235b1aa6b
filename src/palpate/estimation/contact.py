"""What a guarded descent met: tip height over pressing force, from the first contact on.

Touching has three stages: free air, perhaps something soft that gives way while the force rises
slowly, then what the tip is stopped by. The slope of the last stretch, from `LATE` of the force to
all of it, tells a rigid surface from one that gives way; a rigid one is where the tip was held,
carried back along that slope to the force at which the stretch began.

                 tip height
                     |  free air   |   soft   | stiff
               first |-------------.
                     |              `-._
              height |                  `-.___________ held   slope: compliance
                     +-------------------------------> force
                                        knee        full

A contact is where the force rises *and stays*: forces are running medians, so that a sample, or
four, say nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from palpate.estimation import tuning
from palpate.estimation.windows import Mask
from palpate.geometry.pose import Array
from palpate.parameter import Parameter
from palpate.trace.recording import Hand, LeafRun, Recording
from palpate.trace.samples import POSE, Samples, Trace

GUARDED = "MoveUntilContact"
"""The primitive whose leaf is a guarded descent."""


@dataclass(frozen=True, slots=True, eq=False)
class Touch:
    """What a guarded descent met.

    Attributes:
        recording: of the pose in which the tip was held.
        spot: (2,) m, world x and y of the fingertips.
        held: m, tip height at the force `full`, N.
        compliance: m/N, of the last stretch of the loading curve.
        knee: N, the force at which that stretch began; 0 where it began in free air.
        first: m, tip height at which the force began to rise, with its standard deviation.
        lever: m along the closing direction from the middle of the fingers to where the force acts,
            with its standard deviation.
        opening: m, between the fingers.
    """

    recording: Recording
    spot: Array
    held: float
    full: float
    compliance: float
    knee: float
    first: float
    first_std: float
    lever: float
    lever_std: float
    opening: float

    @property
    def height(self) -> float:
        """m, of what stopped the tip, at no force; of what gives way, where it was met."""
        return self.first if self.gives_way else self.held + self.penetration

    @property
    def penetration(self) -> float:
        """m, how far the pressed tip was below that.

        Along the last stretch, as long as it leads to where the contact began; what it shows is
        disturbed by the arm's swing, and then the whole curve is what counts.
        """
        whole = max(self.first - self.held, 0.0)
        if self.gives_way:
            return whole
        stretch = self.compliance * (self.full - self.knee)
        if self.knee > 0.0 or abs(whole - stretch) < 2.0 * self.first_std:
            return stretch
        return whole

    @property
    def secant(self) -> float:
        """m/N, of the whole loading curve."""
        return max(self.first - self.held, 0.0) / self.full

    @property
    def yields(self) -> float:
        """m/N: how much what stopped the tip certainly gives way; where nothing soft is above it,
        by the whole curve as well."""
        if self.knee > 0.0:
            return self.compliance
        return max(self.compliance, self.secant - 2.0 * self.first_std / self.full)

    @property
    def gives_way(self) -> bool:
        """Whether it is no rigid surface."""
        return self.yields > tuning.RIGID

    @property
    def soft(self) -> float:
        """m, thickness of what was pressed through before something stiff was met; 0 for none."""
        thickness = self.first - self.height
        return thickness if thickness > tuning.SOFT and not self.gives_way else 0.0

    @property
    def tells_sides(self) -> bool:
        """Whether one finger alone on something is told from both: the force then acts nearer to it
        than to the middle, by more than twice what the moment may be off."""
        return 2.0 * self.lever_std < self.opening / 4


@dataclass(frozen=True, slots=True, eq=False)
class Descent:
    """Samples from the beginning of a guarded descent to the end of the recording after it.

    Attributes:
        samples: of the whole motion. leaf: the descent itself.
        z: (n,) m, tip height.
        force: (n,) N, pressing down, less what was felt in free air; smooth: its running median.
        noise: N, of a row's force in free air.
        onset: the last row before the contact. pressed: rows of the recording.
    """

    samples: Samples
    leaf: LeafRun
    z: Array
    force: Array
    smooth: Array
    noise: float
    onset: int
    pressed: Mask

    @property
    def full(self) -> float:
        """N, while the pose was recorded."""
        return float(np.mean(self.smooth[self.pressed]))

    @property
    def held(self) -> float:
        """m, tip height meanwhile."""
        return float(np.median(self.z[self.pressed]))

    def crossing(self, force: float) -> int:
        """The first row of the contact at which the force has risen to `force` N."""
        after = np.flatnonzero(self.smooth[self.onset :] >= force)
        return self.onset + int(after[0]) if len(after) else len(self.z) - 1


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


def probes(trace: Trace, parameter: Parameter) -> list[Recording]:
    """The recordings of the pose in contact with a surface."""
    found: list[Recording] = []
    for recording in trace.recordings:
        context = recording.context
        on_it = context.activity == "contact" and context.support == parameter.object
        if recording.buffer == POSE and on_it:
            found.append(recording)
    return found


def touched(trace: Trace, recording: Recording) -> Touch | None:
    """What the guarded descent before a recorded pose met; None where nothing pressed back for
    good.

    Raises:
        ValueError: the recording holds no samples, or no guarded descent comes before it.
    """
    descent = descent_before(trace, recording)
    if descent is None:
        return None
    samples, full, held = descent.samples, descent.full, descent.held
    late = descent.crossing(tuning.LATE_FORCE * full)
    rise = full - tuning.LATE_FORCE * full
    sunk = float(np.median(descent.z[late - 2 : late + 3])) - held
    first, first_std = _first_contact(descent, late)
    lever, lever_std = _lever(descent, trace.hand)
    return Touch(
        recording,
        samples.pose_world_tcp[descent.pressed, :2].mean(axis=0),
        held,
        full,
        compliance=max(sunk, 0.0) / rise,
        knee=_knee(descent, late, first),
        first=first,
        first_std=first_std,
        lever=lever,
        lever_std=lever_std,
        opening=float(np.median(samples.width[descent.pressed])),
    )


def descent_before(trace: Trace, recording: Recording) -> Descent | None:
    """The guarded descent that a recorded pose belongs to; None where it ended with nothing under
    the fingers.

    Raises:
        ValueError: the recording holds no samples, or no guarded descent comes before it.
    """
    leaves = trace.leaf_runs(GUARDED)
    before = [leaf for leaf in leaves if leaf.end <= recording.start + 1e-6]
    if not before:
        raise ValueError(
            "no guarded descent (MoveUntilContact) comes before the recording of the pose"
        )
    leaf = before[-1]
    samples = trace.samples.between(leaf.start, recording.end)
    pressed = (samples.t >= recording.start) & (samples.t <= recording.end)
    if not pressed.any():
        raise ValueError("the recording of the pose holds no samples")
    z = tip_height(samples, trace.hand)
    down = -samples.wrench[:, 2]
    smooth = _running_median(down)
    # Twice: where the contact begins decides how far the free air reaches.
    onset, noise, zero = len(z) // 3, 0.0, 0.0
    for _ in range(2):
        zero, noise = _free_air(samples, down, onset)
        onset = _onset(smooth - zero, noise, samples.t <= leaf.end)
    felt = float(np.mean(smooth[pressed])) - zero
    if felt < tuning.CONTACT_NOISE * max(noise, trace.hand.force_repeatability):
        return None
    return Descent(samples, leaf, z, down - zero, smooth - zero, noise, onset, pressed)


def _running_median(values: Array) -> Array:
    """(n,) of `SUSTAINED` rows about each, the first and the last one repeated beyond the ends."""
    padded = np.pad(values, tuning.SUSTAINED // 2, mode="edge")
    return np.median(sliding_window_view(padded, tuning.SUSTAINED), axis=-1)


def _free_air(samples: Samples, down: Array, onset: int) -> tuple[float, float]:
    """N: what is felt in the later half of the way to the contact, and the noise of a row.

    The noise is the median absolute deviation, which a few wild samples do not reach; of a normal
    distribution its standard deviation is 1.4826 times that.
    """
    told = -np.gradient(samples.target_world_tcp[:, 2], samples.t)[:onset]
    descending = told > tuning.DESCENDING * float(told.max(initial=1e-6))
    steady = descending & _steady(samples)[:onset]
    moving = np.flatnonzero(steady if steady.any() else descending)
    free = down[moving[len(moving) // 2 :]] if len(moving) else down[:1]
    zero = float(np.median(free))
    return zero, 1.4826 * float(np.median(np.abs(free - zero)))


def _onset(smooth: Array, noise: float, rows: Mask) -> int:
    """The last of some rows at which nothing is felt."""
    nothing = max(tuning.SOFT_FORCE, tuning.CONTACT_NOISE * noise / np.sqrt(tuning.SUSTAINED))
    quiet = np.flatnonzero(rows & (smooth < nothing))
    return int(quiet[-1]) if len(quiet) else 0


def _steady(samples: Samples) -> Mask:
    """Rows long enough after the last change of the commanded speed for the arm to have stopped
    swinging: its own inertia is felt before."""
    told = np.gradient(samples.target_world_tcp[:, 2], samples.t)
    changes = np.abs(np.gradient(told, samples.t)) > tuning.SPEED_CHANGE
    last = np.maximum.accumulate(np.where(changes, samples.t, -np.inf))
    return samples.t - last > tuning.SWING


def _first_contact(descent: Descent, late: int) -> tuple[float, float]:
    """m: the tip's height at which the force began to rise, and its standard deviation.

    A rise shows late in the noise, so what gives way is carried back to no force, along the line
    F(z) through the lower half of its way.
    """
    z, onset = descent.z, descent.onset
    met = float(z[min(onset + 1, len(z) - 1)])
    row = float(np.abs(z[min(onset + 1, len(z) - 1)] - z[onset]))
    halfway = (met + float(z[late])) / 2
    rows = np.arange(onset + 1, late + 1)
    rows = rows[(z[rows] >= halfway) & _steady(descent.samples)[rows]]
    if len(rows) < tuning.CURVE_ROWS:
        return met, max(row, tuning.UNSEEN)
    force = descent.smooth[rows]
    slope, offset = np.polyfit(z[rows], force, 1)
    if slope >= 0.0:
        return met, max(row, tuning.UNSEEN)
    root = float(np.clip(-offset / slope, met, met + (met - float(z[late]))))
    residual = float(np.std(descent.force[rows] - (slope * z[rows] + offset)))
    scatter = 2.0 * residual / (-float(slope) * np.sqrt(len(rows)))
    return root, float(np.hypot(scatter, max(row, tuning.UNSEEN)))


def _knee(descent: Descent, late: int, first: float) -> float:
    """N: the force at which the last stretch began, below whatever the tip went through before."""
    stiff = float(descent.z[late])
    if first - stiff < tuning.SOFT:
        return 0.0
    above = stiff + tuning.STIFF_SHARE * (first - stiff)
    soft = np.flatnonzero(descent.z[descent.onset : late + 1] > above)
    last = int(soft[-1]) if len(soft) else 0
    return max(float(descent.smooth[descent.onset + last]), 0.0)


def _lever(descent: Descent, hand: Hand) -> tuple[float, float]:
    """m: where the held force acts along the closing direction, from the middle of the fingertips,
    and its standard deviation.

    At a lever p from there the force F turns the hand about the tips by p x F; about the TCP the
    tips' own lever r adds r x F. A joint's residual friction, `force_repeatability` at the TCP, is
    about `TORQUE_LEVER` times that as a moment.
    """
    samples, pressed = descent.samples, descent.pressed
    free = slice(max(descent.onset - tuning.FREE_ROWS, 0), descent.onset + 1)
    change = np.mean(samples.wrench[pressed], axis=0) - np.median(samples.wrench[free], axis=0)
    w, x, y, z = np.median(samples.pose_world_tcp[pressed, 3:], axis=0)
    closing = np.array([2.0 * (x * y - w * z), 1.0 - 2.0 * (x**2 + z**2), 2.0 * (y * z + w * x)])
    tool = np.array([2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x**2 + y**2)])
    force = change[:3]
    moment = change[3:] - np.cross(hand.tip_offset * tool, force)
    place = np.cross(force, moment) / float(force @ force)
    doubt = tuning.TORQUE_LEVER * hand.force_repeatability
    return float(place @ closing), doubt / descent.full
