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
from palpate.estimation.wrench_observation import observe_wrench
from palpate.trace.recording import LeafRun, NominalHand, Recording
from palpate.trace.samples import POSE, Samples, Trace


def ripple_force(trace: Trace, rows: slice, free: Mask) -> Array:
    """Estimate the pressing force caused by gear ripple during a descent.

    The ripple of each joint is fitted to the torques in free air (`joint_ripple`) and mapped to the tip.

    Args:
        rows: of the trace, n of them.
        free: (n,) those in free air.

    Returns:
        (n,) N. Zeros where the kinematic chain or the ripple cycles of the joints are unknown, or
        where no row is in free air.
    """
    observed, cycles = observe_wrench(trace), trace.hand.ripple_cycles
    if observed.chain is None or cycles is None or not free.any():
        return np.zeros(len(free))
    # Fit the ripple of each joint in free air.
    q = trace.samples.q[rows]
    torques = observed.signals[rows]
    waves = [joint_ripple(q[:, j], torques[:, j], free, n) for j, n in enumerate(cycles)]
    # Map the joint torques to the vertical force on the tip; the pressing force points down.
    seen = observed.wrenches(q)[:, 2, :]
    force: Array = -np.einsum("nm,mn->n", seen, np.array(waves)).astype(np.float64)
    return force


def joint_ripple(q: Array, torque: Array, free: Mask, cycles: float) -> Array:
    """Fit the torque ripple of one joint as two harmonics of its gear.

    Args:
        q: (n,) rad, joint angles.
        torque: (n,) N m.
        free: (n,) rows in free air, to which the ripple is fitted.
        cycles: ripple periods per turn of the joint.

    Returns:
        (n,) N m. Zeros where the joint turned by less than one period in free air, or where the
        ripple does not improve the fit.
    """
    if np.ptp(q[free]) < 2.0 * np.pi / cycles:
        return np.zeros(len(q))
    # Compare a straight line with a line plus ripple, both fitted in free air.
    angle = q - q[free].mean()
    line = np.column_stack([np.ones(len(q)), angle])
    waves = gear_waves(angle, cycles)
    both = np.hstack([line, waves])
    plain, found = (np.linalg.lstsq(x[free], torque[free], rcond=None)[0] for x in (line, both))
    left = (torque - line @ plain)[free], (torque - both @ found)[free]
    # Akaike's criterion with the number of independent rows: each wave must gain 2.
    count = free.sum() / CORRELATED_ROWS
    gained = count * np.log(left[0] @ left[0] / max(left[1] @ left[1], FLOOR**2))
    if gained < 2.0 * waves.shape[1]:
        return np.zeros(len(q))
    ripple: Array = (waves @ found[line.shape[1] :]).astype(np.float64)
    return ripple


def gear_waves(angle: Array, cycles: float) -> Array:
    """Evaluate sine and cosine of the first two gear harmonics at joint angles (n,), rad: (n, 4)."""
    phases = cycles * np.outer(angle, (1.0, 2.0))
    return np.hstack([np.sin(phases), np.cos(phases)])


# Tuning constants of a guarded descent.


SUSTAINED = 9
"""rows (45 ms): window of the running median of the force. Up to four outliers in a row do not
count as contact. Hardly sensitive."""
CONTACT_NOISE = 4.0
"""standard deviations of the noise that a force must exceed to count as contact. Hardly sensitive."""
WRONG_BY = 12.0
"""standard deviations of the wander in free air. A rise of the force by more than this shows a soft
layer, even below the datasheet's force accuracy. Joint friction alone reaches up to 9 of them in
free air. Sensitive for mats of some 100 N/m that carry 1 N; not sensitive for twice that load."""
STEEP = 50.0
"""N/m: `WRONG_BY` applies only to rises steeper than this. Free air alone changed by 9 to 40 N/m over 5 to 60 mm above
a table (some 250 recorded descents of arms with joint friction). Sensitive for mats below 60 N/m."""
SOFT_FORCE = 0.15
"""N: smallest force that counts; the force repeatability that the datasheet states. Hardly sensitive."""
SPEED_CHANGE = 1e-3
"""m/s: change of the commanded speed within `SUSTAINED` rows that counts as a change. A steady
descent shows none, despite time stamp jitter and missing samples. Not sensitive."""
SWING = 0.3
"""s: time after a change of the commanded speed during which the arm oscillates on its springs. Not sensitive."""
SWINGING = 0.1
"""weight of a row during that oscillation. Hardly sensitive."""
FREE_SLOPE = 5.0
"""N/m (1 sigma): change of the force in free air with the height, caused by friction and gravity
errors that depend on the posture. Hardly sensitive."""
CANDIDATES = 50
"""number of trial heights of the first contact before the best one is refined. Not sensitive."""
FREE_ROWS = 60
"""rows (0.3 s) of free air before the contact. They are the reference for the contact moment. Not sensitive."""
LATE_FORCE = 0.6
"""fraction of the pressing force at which the last stretch of the loading curve begins. It is
reached before the stop command, whose oscillation would disturb the curve. Hardly sensitive."""
AT_REST_SHARE = 0.75
"""fraction of the largest force of a press that counts at least as its force at rest. Joint
friction relaxes as the arm stops and may hide the rest. Sensitive: of 100 tables at `measured`, four
were taken for a soft layer 60 to 150 mm too high without it, and one at 0.5."""
STIFF_SHARE = 0.1
"""fraction of the travel through a soft layer that belongs to the stiff stretch below it. Hardly sensitive."""
UNSEEN = 2e-5
"""m (1 sigma): penetration of a rigid surface that no loading curve shows. Not sensitive."""
SOFT = 0.0015
"""m above the rigid surface: an earlier rise of the force shows a soft layer. Not sensitive."""
AT_REST = 0.1
"""s of rest before a descent. They show how joint friction reverses as the arm starts. The
stiffness is hardly sensitive."""
STIFFER = 0.2
"""ratio of the compliance of the last stretch to that above it. Below this ratio the soft layer has
been pressed through. A linear spring has 1, a spring that hardens with the square of the depth
0.44, a table 0. Not sensitive."""
BLOCK_ROWS = 20
"""rows (0.1 s): block length of means in which white noise is small against slower errors. Not sensitive."""
EASED = 5e-4
"""m: rise of the commanded height that shows that the press was eased. Not sensitive."""
WANDERING = 100.0
"""rows of a descent per independent one of the slow errors in free air: 0.5 s, or 10 mm, over which
joint friction changes with the place. Not sensitive with white noise."""

GUARDED = "MoveUntilContact"
"""Primitive whose leaf is a guarded descent."""


@dataclass(frozen=True, slots=True, eq=False)
class Descent:
    """Samples from the start of a guarded descent to the end of the recording after it."""

    samples: Samples  # of the whole motion
    leaf: LeafRun  # the descent itself
    z: Array  # (n,) m, tip height
    force: Array  # (n,) N, pressing force, less that in free air
    smooth: Array  # (n,) N, its running median
    noise: float  # N, standard deviation of a row's force in free air
    onset: int  # last row before the contact
    pressed: Mask  # (n,) rows of the recording
    set_out: Array  # (6,) N, N m, change of the wrench as the arm started: friction of the joints
    # (6,) N, N m, standard deviation of the wrench in free air, in means of `BLOCK_ROWS` rows: friction and drift that
    # change with the place. The entry of the pressing force is about its linear trend.
    wander: Array
    slope: float  # N/m, of that linear trend
    # (n,) N, part of the force caused by friction in joints that reverse during the motion.
    joint_friction: Array

    @property
    def free(self) -> slice:
        """The last rows of free air."""
        return slice(max(self.onset - FREE_ROWS, 0), self.onset + 1)

    @property
    def friction(self) -> float:
        """N, standard deviation of the pressing force by joint friction as the arm stops."""
        # Friction at the start relaxes by a uniformly distributed part (std: 1/sqrt(12) of it). It
        # also changes with the place.
        return float(np.hypot(self.wander[2], self.set_out[2] / np.sqrt(12.0)))

    @property
    def full(self) -> float:
        """N, mean pressing force of the recording, at least `SOFT_FORCE`."""
        return max(float(np.mean(self.smooth[self.pressed])), SOFT_FORCE)

    @property
    def held(self) -> float:
        """m, median tip height of the recording."""
        return float(np.median(self.z[self.pressed]))

    @property
    def borne(self) -> Mask:
        """Rows of the greatest force at rest, see `rows_of_greatest_force`."""
        return rows_of_greatest_force(self.samples, self.pressed)

    def crossing(self, force: float) -> int:
        """Return the first row after the onset at which the force reaches `force` N."""
        after = np.flatnonzero(self.smooth[self.onset :] >= force)
        return self.onset + int(after[0]) if len(after) else len(self.z) - 1

    def last_crossing(self, force: float) -> int:
        """Return the last row before the greatest force at which the force rises above `force` N."""
        return int(np.flatnonzero(self.smooth[: self.smooth.argmax()] < force)[-1]) + 1


def leans(samples: Samples) -> Array:
    """Compute the lean of the hand in the closing direction against the command: (n,) rad.

    A force on one finger alone turns the hand on the arm's springs.
    """
    target = rotations(samples.target_world_tcp[:, 3:])
    return rotations(samples.pose_world_tcp[:, 3:])[:, 2, 1] - target[:, 2, 1]


def probes(trace: Trace, parameter: Parameter) -> list[Recording]:
    """List the recordings of a pose of the empty hand in contact with the parameter's object."""
    found: list[Recording] = []
    for recording in trace.recordings:
        context = recording.context
        empty = context.activity == "contact" and context.holding is None
        on_it = empty and context.support == parameter.object
        if recording.buffer == POSE and on_it:
            found.append(recording)
    return found


def descent_before(trace: Trace, recording: Recording) -> Descent | None:
    """Analyse the guarded descent before a recorded pose; None where it ended without contact.

    Raises ValueError: the recording holds no samples, or no guarded descent comes before it.
    """
    leaves = trace.leaf_runs(GUARDED)
    before = [leaf for leaf in leaves if leaf.end <= recording.start + 1e-6]
    if not before:
        raise ValueError(
            "no guarded descent (MoveUntilContact) comes before the recording of the pose"
        )
    # Cut the samples from the start of the descent to the end of the recorded pose.
    leaf = before[-1]
    samples = trace.samples.between(leaf.start, recording.end)
    pressed = (samples.t >= recording.start) & (samples.t <= recording.end)
    if not pressed.any():
        raise ValueError("the recording of the pose holds no samples")
    # Tip height and pressing force (positive down) of each row.
    z = tip_height(samples, trace.hand)
    down = -samples.wrench[:, 2]
    on_the_way = samples.t <= leaf.end
    first = int(np.searchsorted(trace.samples.t, leaf.start))
    rows = slice(first, first + len(samples))
    smooth = running_median(down)
    met = fit_free_air(samples, z, smooth, trace.hand)
    # Remove the gear ripple, which is fitted in free air, and repeat the fit.
    ripple = ripple_force(trace, rows, on_the_way & steady(samples) & (z > met.height))
    if ripple.any():
        down = down - ripple
        smooth = running_median(down)
        met = fit_free_air(samples, z, smooth, trace.hand)
    # Select the free-air rows after the start-up oscillation, and their noise.
    free_air = met.free_air(z)
    calm = on_the_way & steady(samples) & (z > met.height)
    free = calm if calm.any() else on_the_way & (z >= met.height)
    noise = robust_std((down - free_air)[free])
    # Find the contact onset before the greatest force: a firm press is eased afterwards, and its
    # force may drop to almost zero.
    before = on_the_way & (np.arange(len(smooth)) <= int(np.argmax(smooth - free_air)))
    onset = last_in_free_air(smooth - free_air, robust_std((smooth - free_air)[free]), before)
    # Without a force that exceeds the noise, the descent ended without contact.
    observed = float(np.mean((smooth - free_air)[rows_of_greatest_force(samples, pressed)]))
    if observed < CONTACT_NOISE * max(noise, trace.hand.force_repeatability):
        return None
    # Friction of the joints: change of the wrench from rest to motion, and slow errors in free air.
    resting = trace.samples.between(leaf.start - AT_REST, leaf.start).wrench
    moving: Array = np.median(samples.wrench[free], axis=0)
    set_out = moving - np.median(resting, axis=0) if len(resting) else np.zeros(6)
    wander = block_means(samples.wrench[free]).std(axis=0)
    wander[2] = robust_std(block_means((down - free_air)[free]))
    # Force caused by friction in joints that reverse during the motion.
    force = (down - free_air, smooth - free_air)
    height = float(samples.pose_world_tcp[onset, 2])
    own = joint_friction_force(trace, rows, free, load_rows(trace, None).empty, height)
    return Descent(samples, leaf, z, *force, noise, onset, pressed, set_out, wander, met.slope, own)


def rows_of_greatest_force(samples: Samples, pressed: Mask) -> Mask:
    """Return the rows of the greatest force at rest: `pressed`, or those before the press was eased.

    Joint friction reverses when a press is eased, and may hide the remaining force.
    """
    target = samples.target_world_tcp[:, 2]
    lowest = int(np.argmin(target))
    if target[-1] - target[lowest] < EASED:
        return pressed
    # The last `BLOCK_ROWS` rows before the commanded height rises again.
    risen = np.flatnonzero(target[lowest:] > target[lowest] + EASED / 10)
    rows = np.arange(len(target)) - lowest - int(risen[0])
    return (rows < 0) & (rows >= -BLOCK_ROWS)


def steady(samples: Samples) -> Mask:
    """Return the rows at which the oscillation after the last change of speed has decayed.

    The inertial force has decayed with it, `SWING` s after a change of the commanded speed.
    """
    # A change: the smoothed commanded speed differs across a window of `SUSTAINED` rows.
    speed = running_median(np.gradient(samples.target_world_tcp[:, 2], samples.t))
    half = SUSTAINED // 2
    ends = np.pad(speed, half, mode="edge")
    changes = np.abs(ends[2 * half :] - ends[: len(speed)]) > SPEED_CHANGE
    # Time of the last change at each row.
    last = np.maximum.accumulate(np.where(changes, samples.t, -np.inf))
    return samples.t - last > SWING


def block_means(rows: Array) -> Array:
    """Average blocks of `BLOCK_ROWS` rows along the first axis; one row of zeros if there are fewer rows."""
    count = len(rows) // BLOCK_ROWS
    if not count:
        return np.zeros((1, *rows.shape[1:]))
    whole = rows[: count * BLOCK_ROWS]
    return np.mean(whole.reshape(count, BLOCK_ROWS, *rows.shape[1:]), axis=1)


def running_median(values: Array) -> Array:
    """Compute the (n,) running median over `SUSTAINED` rows; the end values are repeated beyond the ends."""
    padded = np.pad(values, SUSTAINED // 2, mode="edge")
    return np.median(sliding_window_view(padded, SUSTAINED), axis=-1)


@dataclass(frozen=True, slots=True, eq=False)
class ChangePoint:
    """Piecewise linear force: f = a + b (z - z1) + k max(z0 - z, 0)."""

    begin: float  # m, z1, height of the first row
    level: float  # N, a, force in free air at z1
    slope: float  # N/m, b, of the force in free air
    stiffness: float  # N/m, k, of the contact
    height: float  # m, z0, of the contact
    squares: float  # weighted sum of squared residuals, with the prior's term

    def free_air(self, z: Array) -> Array:
        """Evaluate the force in free air, (n,) N."""
        return self.level + self.slope * (z - self.begin)


def fit_free_air(samples: Samples, z: Array, smooth: Array, hand: NominalHand) -> ChangePoint:
    """Fit the force in free air and the height of the first contact.

    The contact is the surface that carries the full force. It is a soft layer above that surface
    instead if the layer carries more than the uncertainty of the force in free air.
    """
    # Change point of the whole motion; rows during the arm's oscillation count less.
    start = int(np.argmax(steady(samples)))
    rows = np.arange(start, len(z))
    weight = np.where(steady(samples), 1.0, SWINGING)
    stopped = change_point(z, smooth, weight, rows)
    bearing = smooth - stopped.free_air(z)
    # Full force. Joint friction may hide most of it at rest, so a share of the greatest force is its lower bound.
    full = max(float(bearing[-1]), AT_REST_SHARE * float(bearing[rows].max()))
    # Second change point from the rows before the last stretch of the loading curve: the top of a soft layer.
    late = np.flatnonzero(bearing[rows] >= LATE_FORCE * full)
    before = rows[: int(late[0]) + 1] if len(late) else rows
    soft = change_point(z, smooth, weight, before)
    bears = soft.stiffness * (soft.height - stopped.height)
    calm = (weight == 1.0) & (z > soft.height)
    if np.count_nonzero(calm) < FREE_ROWS:
        return stopped
    # Accept the soft layer if its force exceeds twice the datasheet's accuracy, or `WRONG_BY` times
    # the wander if the rise is steep.
    wander = robust_std((smooth - soft.free_air(z))[calm])
    doubt = 2.0 * hand.force_accuracy
    if soft.stiffness > STEEP:
        doubt = min(doubt, WRONG_BY * wander)
    if bears < doubt or soft.height - stopped.height < SOFT:
        return stopped
    return soft


def change_point(z: Array, force: Array, weight: Array, rows: NDArray[np.intp]) -> ChangePoint:
    """Fit a change point by weighted least squares to the given rows of height, m, and force, N.

    The slope in free air has a normal prior of `FREE_SLOPE`.
    """
    # The model is linear at a given z0. A coarse search over row heights is refined around its best.
    height, share, begin = z[rows] - z[rows[0]], weight[rows], float(z[rows[0]])
    wanted, air = force[rows] * share, np.stack([share, height * share])
    # Precision of the slope's prior, in units of the noise: `SOFT_FORCE` over `WANDERING` correlated rows.
    prior = np.array([0.0, FREE_SLOPE**-2.0, 0.0]) * SOFT_FORCE**2 * WANDERING

    def best_of(candidates: range) -> tuple[int, ChangePoint]:
        contact = np.maximum(height[candidates, None] - height, 0.0) * share
        # Normal equations of all candidates, which differ in the last column.
        normal, right = np.empty((len(contact), 3, 3)), np.empty((len(contact), 3))
        normal[:, :2, :2], right[:, :2] = air @ air.T, air @ wanted
        normal[:, :2, 2] = normal[:, 2, :2] = contact @ air.T
        normal[:, 2, 2], right[:, 2] = np.einsum("ij,ij->i", contact, contact), contact @ wanted
        normal += np.diag(prior + FLOOR**2)
        # Solve for level, slope and stiffness of each candidate, and sum the squares.
        found = np.linalg.solve(normal, right[:, :, None])[:, :, 0]
        left = wanted - found[:, :2] @ air
        left -= found[:, 2:] * contact
        squares = np.einsum("ij,ij->i", left, left) + found**2 @ prior
        # A contact pushes and does not pull: exclude negative stiffness.
        squares[found[:, 2] <= 0.0] = np.inf
        i = int(squares.argmin())
        met, (level, slope, stiffness) = begin + float(height[candidates[i]]), found[i].tolist()
        return candidates[i], ChangePoint(begin, level, slope, stiffness, met, float(squares[i]))

    # Coarse search, then all rows next to its best.
    step = max(len(rows) // CANDIDATES, 1)
    best, _ = best_of(range(0, len(rows), step))
    return best_of(range(max(best - step, 0), min(best + step, len(rows))))[1]


def robust_std(values: Array) -> float:
    """Estimate a standard deviation from the median absolute deviation of normal values; outliers
    have little effect."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))


def last_in_free_air(smooth: Array, wander: float, rows: Mask) -> int:
    """Return the last of `rows` in which the force is within the scatter `wander`, N, of free air;
    0 if there is none."""
    nothing = max(SOFT_FORCE, CONTACT_NOISE * wander)
    quiet = np.flatnonzero(rows & (smooth < nothing))
    return int(quiet[-1]) if len(quiet) else 0


def at_most(descent: Descent) -> tuple[float, float]:
    """Return the greatest pressing force at rest, N, and the tip height there, m."""
    borne = descent.borne
    return float(np.mean(descent.smooth[borne])), float(np.median(descent.z[borne]))


def first_contact(descent: Descent, late: int) -> tuple[float, float]:
    """Estimate the tip height at which the force begins to rise, m, and its standard deviation, m.

    Noise hides the start of a slow rise. The line F(z) through the upper half of the travel until
    row `late` is extrapolated to zero force.
    """
    # Contact height at the resolution of one row, used where no line can be fitted.
    z, onset = descent.z, descent.onset
    met = float(z[min(onset + 1, len(z) - 1)])
    row = float(np.abs(z[min(onset + 1, len(z) - 1)] - z[onset]))
    # Steady rows of the first half of the travel from the contact to row `late`.
    halfway = (met + float(z[late])) / 2
    rows = np.arange(onset + 1, late + 1)
    rows = rows[(z[rows] >= halfway) & steady(descent.samples)[rows]]
    if len(rows) < CURVE_ROWS:
        return met, max(row, UNSEEN)
    force = descent.smooth[rows]
    slope, offset = np.polyfit(z[rows], force, 1)
    if slope >= 0.0:
        return met, max(row, UNSEEN)
    # Extrapolate the line to zero force, at most as far above the contact as row `late` is below
    # it. Propagate the residual.
    root = float(np.clip(-offset / slope, met, met + (met - float(z[late]))))
    residual = float(np.std(descent.force[rows] - (slope * z[rows] + offset)))
    scatter = 2.0 * residual / (-float(slope) * np.sqrt(len(rows)))
    return root, float(np.hypot(scatter, max(row, UNSEEN)))


def knee(descent: Descent, late: int, first: float) -> float:
    """Return the force, N, at which the last and stiffest stretch of the loading curve begins.

    It is 0 where the stretch begins in free air, without a soft layer above.
    """
    stiff = float(descent.z[late])
    if first - stiff < SOFT:
        return 0.0
    # The stiff stretch is the last `STIFF_SHARE` of the travel since the first contact.
    above = stiff + STIFF_SHARE * (first - stiff)
    soft = np.flatnonzero(descent.z[descent.onset : late + 1] > above)
    last = int(soft[-1]) if len(soft) else 0
    return max(float(descent.smooth[descent.onset + last]), 0.0)


def contact_height_if_rigid(descent: Descent, late: int, first: float) -> float | None:
    """Estimate the height of a rigid surface below a soft layer, m; None without such a surface.

    A layer was pressed through if the compliance of the last stretch, below row `late`, is at most
    `STIFFER` of the compliance above it. The height is the higher of two: the top of the stiff
    stretch (`STIFF_SHARE` of the travel), and the last stretch extrapolated to zero force.

    Args:
        late: row at which the last stretch of the loading curve begins.
        first: m, tip height of the first contact.
    """
    late_z, late_force = float(descent.z[late]), float(descent.smooth[late])
    most, deepest = at_most(descent)
    # Compliances, m/N: from the first contact to row `late`, and from there to the greatest force at rest.
    before = (first - late_z) / late_force
    after = (late_z - deepest) / (most - late_force)
    # No soft layer above, or no sufficient change of the compliance.
    if first - late_z < SOFT or after > STIFFER * before:
        return None
    return late_z + max(STIFF_SHARE * (first - late_z), after * late_force)
