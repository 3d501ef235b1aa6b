"""Guarded descent: tip height and pressing force from free air on, and its loading curve.

A contact is a lasting rise of the force: forces are running medians, which up to four wild samples do not
change.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from palpate.estimation import tuning
from palpate.estimation.contact.ripple import ripple_force
from palpate.estimation.joint_friction import joint_friction_force
from palpate.estimation.load.in_hand import load_rows
from palpate.estimation.motion import Mask, tip_height
from palpate.geometry.pose import Array, rotations
from palpate.parameter import Parameter
from palpate.trace.recording import Hand, LeafRun, Recording
from palpate.trace.samples import POSE, Samples, Trace

GUARDED = "MoveUntilContact"
"""The primitive whose leaf is a guarded descent."""


@dataclass(frozen=True, slots=True, eq=False)
class Descent:
    """Samples from the beginning of a guarded descent to the end of the recording after it.

    Attributes:
        samples: of the whole motion.
        leaf: the descent itself.
        z: (n,) m, tip height.
        force: (n,) N, pressing down, less the force in free air.
        smooth: its running median.
        noise: N, of a row's force in free air.
        onset: the last row before the contact.
        pressed: rows of the recording.
        set_out: (6,) N, N m, change of the wrench as the arm set out: friction of the joints.
        wander: (6,) N, N m, standard deviation of the wrench in free air, in means over some rows: friction
            and drift that change with the place. Of the pressing force, about its linear change.
        slope: N/m, of that linear change.
        joint_friction: (n,) N of the force, by friction in joints that reverse on the way.
    """

    samples: Samples
    leaf: LeafRun
    z: Array
    force: Array
    smooth: Array
    noise: float
    onset: int
    pressed: Mask
    set_out: Array
    wander: Array
    slope: float
    joint_friction: Array

    @property
    def free(self) -> slice:
        """The last rows of free air."""
        return slice(max(self.onset - tuning.FREE_ROWS, 0), self.onset + 1)

    @property
    def friction(self) -> float:
        """N, standard deviation of the pressing force by joint friction as the arm stops."""
        # It relaxes by a part, uniformly distributed, of what it showed as the arm set out, and changes
        # with the place.
        return float(np.hypot(self.wander[2], self.set_out[2] / np.sqrt(12.0)))

    @property
    def full(self) -> float:
        """N, pressing force while the pose was recorded, at least `tuning.SOFT_FORCE`."""
        return max(float(np.mean(self.smooth[self.pressed])), tuning.SOFT_FORCE)

    @property
    def held(self) -> float:
        """m, tip height while the pose was recorded."""
        return float(np.median(self.z[self.pressed]))

    @property
    def borne(self) -> Mask:
        """Rows of the greatest force at rest: of the recording, or before it was eased."""
        return rows_of_greatest_force(self.samples, self.pressed)

    def crossing(self, force: float) -> int:
        """The first row of the contact at which the force has risen to `force` N."""
        after = np.flatnonzero(self.smooth[self.onset :] >= force)
        return self.onset + int(after[0]) if len(after) else len(self.z) - 1

    def last_crossing(self, force: float) -> int:
        """Row before the greatest force from which on the force exceeds `force`, N."""
        return int(np.flatnonzero(self.smooth[: self.smooth.argmax()] < force)[-1]) + 1


def leans(samples: Samples) -> Array:
    """(n,) rad of lean in the closing direction, against the command: a force on one finger alone turns the
    hand on the arm's springs."""
    target = rotations(samples.target_world_tcp[:, 3:])
    return rotations(samples.pose_world_tcp[:, 3:])[:, 2, 1] - target[:, 2, 1]


def probes(trace: Trace, parameter: Parameter) -> list[Recording]:
    """Recordings of the pose in contact with a surface."""
    found: list[Recording] = []
    for recording in trace.recordings:
        context = recording.context
        empty = context.activity == "contact" and context.holding is None
        on_it = empty and context.support == parameter.object
        if recording.buffer == POSE and on_it:
            found.append(recording)
    return found


def descent_before(trace: Trace, recording: Recording) -> Descent | None:
    """Guarded descent before a recorded pose; None where it ended without contact.

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
    on_the_way = samples.t <= leaf.end
    first = int(np.searchsorted(trace.samples.t, leaf.start))
    rows = slice(first, first + len(samples))
    smooth = running_median(down)
    met = fit_free_air(samples, z, smooth, trace.hand)
    ripple = ripple_force(trace, rows, on_the_way & steady(samples) & (z > met.height))
    if ripple.any():
        down = down - ripple
        smooth = running_median(down)
        met = fit_free_air(samples, z, smooth, trace.hand)
    free_air = met.free_air(z)
    calm = on_the_way & steady(samples) & (z > met.height)
    free = calm if calm.any() else on_the_way & (z >= met.height)
    noise = robust_std((down - free_air)[free])
    # A probe that pressed firmly is eased afterwards, and may then press hardly at all.
    before = on_the_way & (np.arange(len(smooth)) <= int(np.argmax(smooth - free_air)))
    onset = last_in_free_air(smooth - free_air, robust_std((smooth - free_air)[free]), before)
    observed = float(np.mean((smooth - free_air)[rows_of_greatest_force(samples, pressed)]))
    if observed < tuning.CONTACT_NOISE * max(noise, trace.hand.force_repeatability):
        return None
    resting = trace.samples.between(leaf.start - tuning.AT_REST, leaf.start).wrench
    moving: Array = np.median(samples.wrench[free], axis=0)
    set_out = moving - np.median(resting, axis=0) if len(resting) else np.zeros(6)
    wander = block_means(samples.wrench[free]).std(axis=0)
    wander[2] = robust_std(block_means((down - free_air)[free]))
    force = (down - free_air, smooth - free_air)
    height = float(samples.pose_world_tcp[onset, 2])
    own = joint_friction_force(trace, rows, free, load_rows(trace, None).empty, height)
    return Descent(samples, leaf, z, *force, noise, onset, pressed, set_out, wander, met.slope, own)


def rows_of_greatest_force(samples: Samples, pressed: Mask) -> Mask:
    """Rows of the greatest force at rest: `pressed`, or before it was eased, as joint friction reverses then
    and may hide the remaining force."""
    target = samples.target_world_tcp[:, 2]
    lowest = int(np.argmin(target))
    if target[-1] - target[lowest] < tuning.EASED:
        return pressed
    risen = np.flatnonzero(target[lowest:] > target[lowest] + tuning.EASED / 10)
    rows = np.arange(len(target)) - lowest - int(risen[0])
    return (rows < 0) & (rows >= -tuning.BLOCK_ROWS)


def steady(samples: Samples) -> Mask:
    """Rows long enough after the last change of the commanded speed for the arm's oscillation, and
    with it the inertial force, to have decayed."""
    speed = running_median(np.gradient(samples.target_world_tcp[:, 2], samples.t))
    half = tuning.SUSTAINED // 2
    ends = np.pad(speed, half, mode="edge")
    changes = np.abs(ends[2 * half :] - ends[: len(speed)]) > tuning.SPEED_CHANGE
    last = np.maximum.accumulate(np.where(changes, samples.t, -np.inf))
    return samples.t - last > tuning.SWING


def block_means(rows: Array) -> Array:
    """Means of `BLOCK_ROWS` rows each, along the first axis; zeros where there are fewer rows."""
    count = len(rows) // tuning.BLOCK_ROWS
    if not count:
        return np.zeros((1, *rows.shape[1:]))
    whole = rows[: count * tuning.BLOCK_ROWS]
    return np.mean(whole.reshape(count, tuning.BLOCK_ROWS, *rows.shape[1:]), axis=1)


def running_median(values: Array) -> Array:
    """(n,) median of `SUSTAINED` rows about each, the first and the last repeated beyond the ends."""
    padded = np.pad(values, tuning.SUSTAINED // 2, mode="edge")
    return np.median(sliding_window_view(padded, tuning.SUSTAINED), axis=-1)


@dataclass(frozen=True, slots=True, eq=False)
class ChangePoint:
    """f = a + b (z - z1) + k max(z0 - z, 0): a and b of free air, k and z0 (`height`) of the contact;
    `squares`: weighted sum of squared residuals."""

    begin: float
    level: float
    slope: float
    stiffness: float
    height: float
    squares: float

    def free_air(self, z: Array) -> Array:
        """(n,) N."""
        return self.level + self.slope * (z - self.begin)


def fit_free_air(samples: Samples, z: Array, smooth: Array, hand: Hand) -> ChangePoint:
    """Fit free air and the first contact: what bears the full force, or something soft above it that bears
    more than the uncertainty of the force in free air."""
    start = int(np.argmax(steady(samples)))
    rows = np.arange(start, len(z))
    weight = np.where(steady(samples), 1.0, tuning.SWINGING)
    stopped = change_point(z, smooth, weight, rows)
    bearing = smooth - stopped.free_air(z)
    # At rest, friction of the joints may hide most of the force.
    full = max(float(bearing[-1]), tuning.AT_REST_SHARE * float(bearing[rows].max()))
    late = np.flatnonzero(bearing[rows] >= tuning.LATE_FORCE * full)
    before = rows[: int(late[0]) + 1] if len(late) else rows
    soft = change_point(z, smooth, weight, before)
    bears = soft.stiffness * (soft.height - stopped.height)
    calm = (weight == 1.0) & (z > soft.height)
    if np.count_nonzero(calm) < tuning.FREE_ROWS:
        return stopped
    wander = robust_std((smooth - soft.free_air(z))[calm])
    doubt = 2.0 * hand.force_accuracy
    if soft.stiffness > tuning.STEEP:
        doubt = min(doubt, tuning.WRONG_BY * wander)
    if bears < doubt or soft.height - stopped.height < tuning.SOFT:
        return stopped
    return soft


def change_point(z: Array, force: Array, weight: Array, rows: NDArray[np.intp]) -> ChangePoint:
    """Change point by weighted least squares among some rows."""
    # Linear at each z0, the height of a row; the best of a few rows is refined.
    height, share, begin = z[rows] - z[rows[0]], weight[rows], float(z[rows[0]])
    wanted, air = force[rows] * share, np.stack([share, height * share])
    prior = np.array([0.0, tuning.FREE_SLOPE**-2.0, 0.0]) * tuning.SOFT_FORCE**2 * tuning.WANDERING

    def best_of(candidates: range) -> tuple[int, ChangePoint]:
        contact = np.maximum(height[candidates, None] - height, 0.0) * share
        # Normal equations of all candidates, which differ in the last column.
        normal, right = np.empty((len(contact), 3, 3)), np.empty((len(contact), 3))
        normal[:, :2, :2], right[:, :2] = air @ air.T, air @ wanted
        normal[:, :2, 2] = normal[:, 2, :2] = contact @ air.T
        normal[:, 2, 2], right[:, 2] = np.einsum("ij,ij->i", contact, contact), contact @ wanted
        normal += np.diag(prior + tuning.FLOOR**2)
        found = np.linalg.solve(normal, right[:, :, None])[:, :, 0]
        left = wanted - found[:, :2] @ air
        left -= found[:, 2:] * contact
        squares = np.einsum("ij,ij->i", left, left) + found**2 @ prior
        # A contact pushes, it does not pull.
        squares[found[:, 2] <= 0.0] = np.inf
        i = int(squares.argmin())
        met, (level, slope, stiffness) = begin + float(height[candidates[i]]), found[i].tolist()
        return candidates[i], ChangePoint(begin, level, slope, stiffness, met, float(squares[i]))

    step = max(len(rows) // tuning.CANDIDATES, 1)
    best, _ = best_of(range(0, len(rows), step))
    return best_of(range(max(best - step, 0), min(best + step, len(rows))))[1]


def robust_std(values: Array) -> float:
    """Standard deviation of a normal distribution with this median absolute deviation, robust to wild samples."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))


def last_in_free_air(smooth: Array, wander: float, rows: Mask) -> int:
    """Last row in which the force is within the scatter of free air, N."""
    nothing = max(tuning.SOFT_FORCE, tuning.CONTACT_NOISE * wander)
    quiet = np.flatnonzero(rows & (smooth < nothing))
    return int(quiet[-1]) if len(quiet) else 0


def at_most(descent: Descent) -> tuple[float, float]:
    """Greatest pressing force at rest, N, and the tip height, m, at it."""
    borne = descent.borne
    return float(np.mean(descent.smooth[borne])), float(np.median(descent.z[borne]))


def first_contact(descent: Descent, late: int) -> tuple[float, float]:
    """Tip height at which the force begins to rise, m, and its standard deviation."""
    # Noise hides the beginning of a slow rise: the line F(z) through its lower half is carried back to no force.
    z, onset = descent.z, descent.onset
    met = float(z[min(onset + 1, len(z) - 1)])
    row = float(np.abs(z[min(onset + 1, len(z) - 1)] - z[onset]))
    halfway = (met + float(z[late])) / 2
    rows = np.arange(onset + 1, late + 1)
    rows = rows[(z[rows] >= halfway) & steady(descent.samples)[rows]]
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


def knee(descent: Descent, late: int, first: float) -> float:
    """Force at which the last, stiffest stretch of the curve begins, N."""
    stiff = float(descent.z[late])
    if first - stiff < tuning.SOFT:
        return 0.0
    above = stiff + tuning.STIFF_SHARE * (first - stiff)
    soft = np.flatnonzero(descent.z[descent.onset : late + 1] > above)
    last = int(soft[-1]) if len(soft) else 0
    return max(float(descent.smooth[descent.onset + last]), 0.0)


def bottomed(descent: Descent, late: int, first: float) -> float | None:
    """Tip height, m, at which the surface became far stiffer than above, or where its last stretch carried back
    has no force, if that is higher; None where it did not."""
    late_z, late_force = float(descent.z[late]), float(descent.smooth[late])
    most, deepest = at_most(descent)
    before = (first - late_z) / late_force
    after = (late_z - deepest) / (most - late_force)
    if first - late_z < tuning.SOFT or after > tuning.STIFFER * before:
        return None
    return late_z + max(tuning.STIFF_SHARE * (first - late_z), after * late_force)
