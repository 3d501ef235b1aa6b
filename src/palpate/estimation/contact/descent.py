"""Guarded descent: tip height and pressing force, from free air on.

A contact is where the force rises *and stays*: forces are running medians, so that a sample, or
four, say nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from palpate.estimation import tuning
from palpate.estimation.joint_friction import joint_friction_force
from palpate.estimation.load.segments import load_rows
from palpate.estimation.motion import Mask
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
        force: (n,) N, pressing down, less what was felt in free air.
        smooth: its running median.
        noise: N, of a row's force in free air.
        onset: the last row before the contact.
        pressed: rows of the recording.
        set_out: (6,) N, N m, by how much the wrench changed as the arm set out: the joints' friction.
        wander: (6,) N, N m, standard deviation of the wrench on the way through free air, in means
            over some rows: friction and drift that change with the place. Of the pressing force,
            what its even change leaves.
        slope: N/m, that change.
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
        """N, standard deviation of the pressing force by joint friction as the arm stops: the
        friction relaxes by between nothing and all of what it showed as the arm set out (uniform
        distribution), and differs from place to place."""
        return float(np.hypot(self.wander[2], self.set_out[2] / np.sqrt(12.0)))

    @property
    def full(self) -> float:
        """N, while the pose was recorded; no less than what is a force at all."""
        return max(float(np.mean(self.smooth[self.pressed])), tuning.SOFT_FORCE)

    @property
    def held(self) -> float:
        """m, tip height meanwhile."""
        return float(np.median(self.z[self.pressed]))

    @property
    def borne(self) -> Mask:
        """Rows in which it pressed most at rest: of the recording, or before it was eased."""
        return _borne(self.samples, self.pressed)

    def crossing(self, force: float) -> int:
        """The first row of the contact at which the force has risen to `force` N."""
        after = np.flatnonzero(self.smooth[self.onset :] >= force)
        return self.onset + int(after[0]) if len(after) else len(self.z) - 1


def tip_height(samples: Samples, hand: Hand) -> Array:
    """(n,) world z of the lower fingertip, m.

    Seen from the side the hand is a T: from the TCP the tips lie `tip_offset` along the tool axis
    z, and half the opening to either side along the closing direction y. When the hand leans over
    in that direction, one tip is lower than the other by the opening times the sine of the lean,
    and that one touches first.
    """
    turned = rotations(samples.pose_world_tcp[:, 3:])
    middle = samples.pose_world_tcp[:, 2] + hand.tip_offset * turned[:, 2, 2]
    return middle - samples.width / 2 * np.abs(turned[:, 2, 1])


def leans(samples: Samples) -> Array:
    """(n,) rad by which the hand leans over in the closing direction, against its command: what
    presses on one finger alone turns the hand on the arm's springs."""
    told = rotations(samples.target_world_tcp[:, 3:])
    return rotations(samples.pose_world_tcp[:, 3:])[:, 2, 1] - told[:, 2, 1]


def probes(trace: Trace, parameter: Parameter) -> list[Recording]:
    """The recordings of the pose in contact with a surface."""
    found: list[Recording] = []
    for recording in trace.recordings:
        context = recording.context
        empty = context.activity == "contact" and context.holding is None
        on_it = empty and context.support == parameter.object
        if recording.buffer == POSE and on_it:
            found.append(recording)
    return found


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
    smooth = running_median(down)
    met = _free_air(samples, z, smooth, trace.hand)
    free_air = met.free_air(z)
    on_the_way = samples.t <= leaf.end
    calm = on_the_way & steady(samples) & (z > met.height)
    free = calm if calm.any() else on_the_way & (z >= met.height)
    noise = _spread((down - free_air)[free])
    # A probe that pressed firmly is eased afterwards, and may then press hardly at all.
    before = on_the_way & (np.arange(len(smooth)) <= int(np.argmax(smooth - free_air)))
    onset = _onset(smooth - free_air, _spread((smooth - free_air)[free]), before)
    observed = float(np.mean((smooth - free_air)[_borne(samples, pressed)]))
    if observed < tuning.CONTACT_NOISE * max(noise, trace.hand.force_repeatability):
        return None
    resting = trace.samples.between(leaf.start - tuning.AT_REST, leaf.start).wrench
    moving: Array = np.median(samples.wrench[free], axis=0)
    set_out = moving - np.median(resting, axis=0) if len(resting) else np.zeros(6)
    wander = block_means(samples.wrench[free]).std(axis=0)
    wander[2] = _spread(block_means((down - free_air)[free]))
    force = (down - free_air, smooth - free_air)
    first = int(np.searchsorted(trace.samples.t, leaf.start))
    rows = slice(first, first + len(samples))
    height = float(samples.pose_world_tcp[onset, 2])
    own = joint_friction_force(trace, rows, free, load_rows(trace, None).empty, height)
    return Descent(samples, leaf, z, *force, noise, onset, pressed, set_out, wander, met.slope, own)


def _borne(samples: Samples, pressed: Mask) -> Mask:
    """Rows in which the arm pressed most at rest: `pressed`, or before it was eased. Joints that rub turn
    round then, and may hide what is left of the force."""
    told = samples.target_world_tcp[:, 2]
    lowest = int(np.argmin(told))
    if told[-1] - told[lowest] < tuning.EASED:
        return pressed
    risen = np.flatnonzero(told[lowest:] > told[lowest] + tuning.EASED / 10)
    rows = np.arange(len(told)) - lowest - int(risen[0])
    return (rows < 0) & (rows >= -tuning.BLOCK_ROWS)


def steady(samples: Samples) -> Mask:
    """Rows long enough after the last change of the commanded speed for the arm's oscillation, and
    with it the inertial force, to have decayed."""
    told = running_median(np.gradient(samples.target_world_tcp[:, 2], samples.t))
    half = tuning.SUSTAINED // 2
    ends = np.pad(told, half, mode="edge")
    changes = np.abs(ends[2 * half :] - ends[: len(told)]) > tuning.SPEED_CHANGE
    last = np.maximum.accumulate(np.where(changes, samples.t, -np.inf))
    return samples.t - last > tuning.SWING


def block_means(rows: Array) -> Array:
    """Means of `BLOCK_ROWS` rows each, as many as there are, along the first axis; of what is shorter
    zeros."""
    count = len(rows) // tuning.BLOCK_ROWS
    if not count:
        return np.zeros((1, *rows.shape[1:]))
    whole = rows[: count * tuning.BLOCK_ROWS]
    return np.mean(whole.reshape(count, tuning.BLOCK_ROWS, *rows.shape[1:]), axis=1)


def running_median(values: Array) -> Array:
    """(n,) of `SUSTAINED` rows about each, the first and the last one repeated beyond the ends."""
    padded = np.pad(values, tuning.SUSTAINED // 2, mode="edge")
    return np.median(sliding_window_view(padded, tuning.SUSTAINED), axis=-1)


@dataclass(frozen=True, slots=True, eq=False)
class _ChangePoint:
    """f = a + b (z - z1) + k max(z0 - z, 0): a and b are free air, which changes with the place, k
    and z0 (`height`) what is met. `squares`: what it leaves, weighted."""

    begin: float
    level: float
    slope: float
    stiffness: float
    height: float
    squares: float

    def free_air(self, z: Array) -> Array:
        """(n,) N."""
        return self.level + self.slope * (z - self.begin)


def _free_air(samples: Samples, z: Array, smooth: Array, hand: Hand) -> _ChangePoint:
    """Baseline of the force in free air, and the row of first contact.

    What bears the full force is met first, unless something soft above it bears more than the
    force in free air may be wrong by.
    """
    start = int(np.argmax(steady(samples)))
    rows = np.arange(start, len(z))
    weight = np.where(steady(samples), 1.0, tuning.SWINGING)
    stopped = _change_point(z, smooth, weight, rows)
    bearing = smooth - stopped.free_air(z)
    late = np.flatnonzero(bearing[rows] >= tuning.LATE_FORCE * bearing[-1])
    before = rows[: int(late[0]) + 1] if len(late) else rows
    soft = _change_point(z, smooth, weight, before)
    bears = soft.stiffness * (soft.height - stopped.height)
    calm = (weight == 1.0) & (z > soft.height)
    known = np.count_nonzero(calm) >= tuning.FREE_ROWS
    wander = _spread((smooth - soft.free_air(z))[calm]) if known else np.inf
    doubt = 2.0 * hand.force_accuracy
    if soft.stiffness > tuning.STEEP:
        doubt = min(doubt, tuning.WRONG_BY * wander)
    if bears < doubt or soft.height - stopped.height < tuning.SOFT:
        return stopped
    return soft


def _change_point(z: Array, force: Array, weight: Array, rows: NDArray[np.intp]) -> _ChangePoint:
    """By weighted least squares among some rows. At each z0, the height of a row, it is a linear
    problem; the best of a few is refined."""
    height, share, begin = z[rows] - z[rows[0]], weight[rows], float(z[rows[0]])
    wanted = force[rows] * share
    believed = (
        np.diag([0.0, tuning.FREE_SLOPE**-2.0, 0.0]) * tuning.SOFT_FORCE**2 * tuning.WANDERING
    )

    def at(row: int) -> _ChangePoint:
        columns = (np.ones(len(rows)), height, np.maximum(height[row] - height, 0.0))
        design = np.column_stack(columns) * share[:, None]
        normal = design.T @ design + believed + tuning.FLOOR**2 * np.eye(3)
        found = np.linalg.solve(normal, design.T @ wanted).astype(np.float64)
        left = wanted - design @ found
        squares = float(left @ left + found @ believed @ found)
        level, slope, stiffness = found.tolist()
        met = begin + float(height[row])
        # What is met presses back.
        misfit = squares if stiffness > 0.0 else np.inf
        return _ChangePoint(begin, level, slope, stiffness, met, misfit)

    step = max(len(rows) // tuning.CANDIDATES, 1)
    coarse = {row: at(row) for row in range(0, len(rows), step)}
    best = min(coarse, key=lambda row: coarse[row].squares)
    near = range(max(best - step, 0), min(best + step, len(rows)))
    return min((at(row) for row in near), key=lambda found: found.squares)


def _spread(values: Array) -> float:
    """Standard deviation by the median absolute deviation, which a few wild samples do not reach; of
    a normal distribution it is 1.4826 times that."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))


def _onset(smooth: Array, wander: float, rows: Mask) -> int:
    """Last row in which the force is within the scatter of free air, N."""
    nothing = max(tuning.SOFT_FORCE, tuning.CONTACT_NOISE * wander)
    quiet = np.flatnonzero(rows & (smooth < nothing))
    return int(quiet[-1]) if len(quiet) else 0


def at_most(descent: Descent) -> tuple[float, float]:
    """N that it pressed with at rest at most, and m, tip height meanwhile."""
    borne = descent.borne
    return float(np.mean(descent.smooth[borne])), float(np.median(descent.z[borne]))


def first_contact(descent: Descent, late: int) -> tuple[float, float]:
    """Tip height at which the force begins to rise, m, and its standard deviation.

    A rise shows late in the noise, so what gives way is carried back to no force, along the line
    F(z) through the lower half of its way.
    """
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
    """m: the tip's height at which the surface became far stiffer than it had been: where its last stretch
    would bear nothing, if that is higher."""
    late_z, late_force = float(descent.z[late]), float(descent.smooth[late])
    most, deepest = at_most(descent)
    before = (first - late_z) / late_force
    after = (late_z - deepest) / (most - late_force)
    if first - late_z < tuning.SOFT or after > tuning.STIFFER * before:
        return None
    return late_z + max(tuning.STIFF_SHARE * (first - late_z), after * late_force)
