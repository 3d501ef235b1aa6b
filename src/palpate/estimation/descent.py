"""Guarded descents: tip height over pressing force, without the ripple of the gears."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from palpate.common.parameter import Parameter
from palpate.common.pose import Array, rotations
from palpate.estimation.joint_friction import (
    CORRELATED_ROWS,
    CURVE_ROWS,
    FLOOR,
    joint_friction_force,
)
from palpate.estimation.load_noise import load_rows
from palpate.estimation.motion import Mask, tip_height
from palpate.estimation.wrench_observation import observe
from palpate.trace.recording import LeafRun, NominalHand, Recording
from palpate.trace.samples import POSE, Samples, Trace


def ripple_force(trace: Trace, rows: slice, free: Mask) -> Array:
    """(n,) N that ripple adds to the pressing force in `rows` of a descent, as its rows in `free` air (n,) show it;
    0 where the arm's chain, or how often a joint's gear ripples, is unknown."""
    observed, cycles = observe(trace), trace.hand.ripple_cycles
    if observed.chain is None or cycles is None or not free.any():
        return np.zeros(len(free))
    q = trace.samples.q[rows]
    torques = observed.signals[rows]
    waves = [joint_ripple(q[:, j], torques[:, j], free, n) for j, n in enumerate(cycles)]
    seen = observed.wrenches(q)[:, 2, :]
    force: Array = -np.einsum("nm,mn->n", seen, np.array(waves)).astype(np.float64)
    return force


def joint_ripple(q: Array, torque: Array, free: Mask, cycles: float) -> Array:
    """(n,) N m of a joint's ripple at angles `q` (n,), by the `torque` (n,) in `free` air; 0 where it turned by less
    than a cycle there, or shows none."""
    if np.ptp(q[free]) < 2.0 * np.pi / cycles:
        return np.zeros(len(q))
    angle = q - q[free].mean()
    line = np.column_stack([np.ones(len(q)), angle])
    waves = gear_waves(angle, cycles)
    both = np.hstack([line, waves])
    plain, found = (np.linalg.lstsq(x[free], torque[free], rcond=None)[0] for x in (line, both))
    left = (torque - line @ plain)[free], (torque - both @ found)[free]
    # Akaike's criterion, of as many rows as are independent.
    count = free.sum() / CORRELATED_ROWS
    gained = count * np.log(left[0] @ left[0] / max(left[1] @ left[1], FLOOR**2))
    if gained < 2.0 * waves.shape[1]:
        return np.zeros(len(q))
    ripple: Array = (waves @ found[line.shape[1] :]).astype(np.float64)
    return ripple


def gear_waves(angle: Array, cycles: float) -> Array:
    """(n, 4) unit waves of a gear at a joint's angles (n,), rad: sines and cosines of two harmonics."""
    phases = cycles * np.outer(angle, (1.0, 2.0))
    return np.hstack([np.sin(phases), np.cos(phases)])


# Guarded descent: tip height and pressing force from free air on, and its loading curve.


SUSTAINED = 9
"""rows, 45 ms, whose running median is a force: up to four wild samples in a row are no contact. Sensitive: hardly."""
CONTACT_NOISE = 4.0
"""standard deviations of the noise that a force must exceed to be contact. Sensitive: hardly."""
WRONG_BY = 12.0
"""standard deviations of what free air wanders by, from which on a rise over its line is something soft, though it
were less than what a datasheet says that a force may be wrong by. Where joints rub, free air makes up to 9 of it by
itself. Sensitive: mats of some 100 N/m that bear 1 N, not at all at half of it."""
STEEP = 50.0
"""N/m above which that counts: free air by itself changed by 9 to 40 N/m over 5 to 60 mm before a table (some 250
recorded descents of arms whose joints rub). Sensitive: mats below 60 N/m."""
SOFT_FORCE = 0.15
"""N: a lower force is none; the repeatability of a force that the datasheet states. Sensitive: hardly."""
SPEED_CHANGE = 1e-3
"""m/s within `SUSTAINED` rows from which the commanded motion changes its speed; a steady descent has none, though
stamps jitter and samples are missing. Sensitive: no."""
SWING = 0.3
"""s after a change of the commanded speed in which the arm still swings on its springs. Sensitive: no."""
SWINGING = 0.1
"""weight of a row at which it does. Sensitive: hardly."""
FREE_SLOPE = 5.0
"""N/m (1 sigma): how the force in free air changes along the way down, by friction and gravity that change with the
place. Sensitive: hardly."""
CANDIDATES = 50
"""places of the first contact that are tried before the best of them is refined. Sensitive: no."""
FREE_ROWS = 60
"""rows, 0.3 s, of free air before the contact, to which the moment of the contact is referred. Sensitive: no."""
LATE_FORCE = 0.6
"""part of the pressing force from which the last stretch of the loading curve reaches to all of it: reached before
the arm is told to stop, whose swing would disturb it. Sensitive: hardly."""
AT_REST_SHARE = 0.75
"""part of the largest force of a press that at least counts as its force at rest: joint friction, which relaxes as the
arm stops, may hide the rest. Sensitive: of 100 tables at `measured` four were taken for something soft 60 to 150 mm
above without it, one at 0.5."""
STIFF_SHARE = 0.1
"""part of the way through something soft that still belongs to the stiff stretch below it. Sensitive: hardly."""
UNSEEN = 2e-5
"""m (1 sigma): penetration of a rigid surface that no loading curve shows. Sensitive: no."""
SOFT = 0.0015
"""m above the rigid surface from which an earlier rise of the force is something soft. Sensitive: no."""
AT_REST = 0.1
"""s before a descent in which the arm rests, which tells how its friction turns round as it sets out. Sensitive:
stiffness hardly."""
STIFFER = 0.2
"""part of a surface's compliance so far, below which it has been pressed through: an even spring keeps all of it,
one that hardens with the square of the depth 0.44, a table none. Sensitive: no."""
BLOCK_ROWS = 20
"""rows, 0.1 s, of a descent over whose means white noise is small beside what else there is. Sensitive: no."""
EASED = 5e-4
"""m by which the hand was told to rise again where what it pressed with was eased. Sensitive: no."""
WANDERING = 100.0
"""rows of a descent per independent one of what wanders in free air: half a second, or 10 mm, over which the joints'
friction changes with the place. Sensitive: no, where noise is white."""

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
        return slice(max(self.onset - FREE_ROWS, 0), self.onset + 1)

    @property
    def friction(self) -> float:
        """N, standard deviation of the pressing force by joint friction as the arm stops."""
        # It relaxes by a part, uniformly distributed, of what it showed as the arm set out, and changes
        # with the place.
        return float(np.hypot(self.wander[2], self.set_out[2] / np.sqrt(12.0)))

    @property
    def full(self) -> float:
        """N, pressing force while the pose was recorded, at least `SOFT_FORCE`."""
        return max(float(np.mean(self.smooth[self.pressed])), SOFT_FORCE)

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
    if observed < CONTACT_NOISE * max(noise, trace.hand.force_repeatability):
        return None
    resting = trace.samples.between(leaf.start - AT_REST, leaf.start).wrench
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
    if target[-1] - target[lowest] < EASED:
        return pressed
    risen = np.flatnonzero(target[lowest:] > target[lowest] + EASED / 10)
    rows = np.arange(len(target)) - lowest - int(risen[0])
    return (rows < 0) & (rows >= -BLOCK_ROWS)


def steady(samples: Samples) -> Mask:
    """Rows long enough after the last change of the commanded speed for the arm's oscillation, and
    with it the inertial force, to have decayed."""
    speed = running_median(np.gradient(samples.target_world_tcp[:, 2], samples.t))
    half = SUSTAINED // 2
    ends = np.pad(speed, half, mode="edge")
    changes = np.abs(ends[2 * half :] - ends[: len(speed)]) > SPEED_CHANGE
    last = np.maximum.accumulate(np.where(changes, samples.t, -np.inf))
    return samples.t - last > SWING


def block_means(rows: Array) -> Array:
    """Means of `BLOCK_ROWS` rows each, along the first axis; zeros where there are fewer rows."""
    count = len(rows) // BLOCK_ROWS
    if not count:
        return np.zeros((1, *rows.shape[1:]))
    whole = rows[: count * BLOCK_ROWS]
    return np.mean(whole.reshape(count, BLOCK_ROWS, *rows.shape[1:]), axis=1)


def running_median(values: Array) -> Array:
    """(n,) median of `SUSTAINED` rows about each, the first and the last repeated beyond the ends."""
    padded = np.pad(values, SUSTAINED // 2, mode="edge")
    return np.median(sliding_window_view(padded, SUSTAINED), axis=-1)


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


def fit_free_air(samples: Samples, z: Array, smooth: Array, hand: NominalHand) -> ChangePoint:
    """Fit free air and the first contact: what bears the full force, or something soft above it that bears
    more than the uncertainty of the force in free air."""
    start = int(np.argmax(steady(samples)))
    rows = np.arange(start, len(z))
    weight = np.where(steady(samples), 1.0, SWINGING)
    stopped = change_point(z, smooth, weight, rows)
    bearing = smooth - stopped.free_air(z)
    # At rest, friction of the joints may hide most of the force.
    full = max(float(bearing[-1]), AT_REST_SHARE * float(bearing[rows].max()))
    late = np.flatnonzero(bearing[rows] >= LATE_FORCE * full)
    before = rows[: int(late[0]) + 1] if len(late) else rows
    soft = change_point(z, smooth, weight, before)
    bears = soft.stiffness * (soft.height - stopped.height)
    calm = (weight == 1.0) & (z > soft.height)
    if np.count_nonzero(calm) < FREE_ROWS:
        return stopped
    wander = robust_std((smooth - soft.free_air(z))[calm])
    doubt = 2.0 * hand.force_accuracy
    if soft.stiffness > STEEP:
        doubt = min(doubt, WRONG_BY * wander)
    if bears < doubt or soft.height - stopped.height < SOFT:
        return stopped
    return soft


def change_point(z: Array, force: Array, weight: Array, rows: NDArray[np.intp]) -> ChangePoint:
    """Change point by weighted least squares among some rows."""
    # Linear at each z0, the height of a row; the best of a few rows is refined.
    height, share, begin = z[rows] - z[rows[0]], weight[rows], float(z[rows[0]])
    wanted, air = force[rows] * share, np.stack([share, height * share])
    prior = np.array([0.0, FREE_SLOPE**-2.0, 0.0]) * SOFT_FORCE**2 * WANDERING

    def best_of(candidates: range) -> tuple[int, ChangePoint]:
        contact = np.maximum(height[candidates, None] - height, 0.0) * share
        # Normal equations of all candidates, which differ in the last column.
        normal, right = np.empty((len(contact), 3, 3)), np.empty((len(contact), 3))
        normal[:, :2, :2], right[:, :2] = air @ air.T, air @ wanted
        normal[:, :2, 2] = normal[:, 2, :2] = contact @ air.T
        normal[:, 2, 2], right[:, 2] = np.einsum("ij,ij->i", contact, contact), contact @ wanted
        normal += np.diag(prior + FLOOR**2)
        found = np.linalg.solve(normal, right[:, :, None])[:, :, 0]
        left = wanted - found[:, :2] @ air
        left -= found[:, 2:] * contact
        squares = np.einsum("ij,ij->i", left, left) + found**2 @ prior
        # A contact pushes, it does not pull.
        squares[found[:, 2] <= 0.0] = np.inf
        i = int(squares.argmin())
        met, (level, slope, stiffness) = begin + float(height[candidates[i]]), found[i].tolist()
        return candidates[i], ChangePoint(begin, level, slope, stiffness, met, float(squares[i]))

    step = max(len(rows) // CANDIDATES, 1)
    best, _ = best_of(range(0, len(rows), step))
    return best_of(range(max(best - step, 0), min(best + step, len(rows))))[1]


def robust_std(values: Array) -> float:
    """Standard deviation of a normal distribution with this median absolute deviation, robust to wild samples."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))


def last_in_free_air(smooth: Array, wander: float, rows: Mask) -> int:
    """Last row in which the force is within the scatter of free air, N."""
    nothing = max(SOFT_FORCE, CONTACT_NOISE * wander)
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
    if len(rows) < CURVE_ROWS:
        return met, max(row, UNSEEN)
    force = descent.smooth[rows]
    slope, offset = np.polyfit(z[rows], force, 1)
    if slope >= 0.0:
        return met, max(row, UNSEEN)
    root = float(np.clip(-offset / slope, met, met + (met - float(z[late]))))
    residual = float(np.std(descent.force[rows] - (slope * z[rows] + offset)))
    scatter = 2.0 * residual / (-float(slope) * np.sqrt(len(rows)))
    return root, float(np.hypot(scatter, max(row, UNSEEN)))


def knee(descent: Descent, late: int, first: float) -> float:
    """Force at which the last, stiffest stretch of the curve begins, N."""
    stiff = float(descent.z[late])
    if first - stiff < SOFT:
        return 0.0
    above = stiff + STIFF_SHARE * (first - stiff)
    soft = np.flatnonzero(descent.z[descent.onset : late + 1] > above)
    last = int(soft[-1]) if len(soft) else 0
    return max(float(descent.smooth[descent.onset + last]), 0.0)


def contact_height_if_rigid(descent: Descent, late: int, first: float) -> float | None:
    """Tip height, m, at which the surface became far stiffer than above, or where its last stretch carried back
    has no force, if that is higher; None where it did not."""
    late_z, late_force = float(descent.z[late]), float(descent.smooth[late])
    most, deepest = at_most(descent)
    before = (first - late_z) / late_force
    after = (late_z - deepest) / (most - late_force)
    if first - late_z < SOFT or after > STIFFER * before:
        return None
    return late_z + max(STIFF_SHARE * (first - late_z), after * late_force)
