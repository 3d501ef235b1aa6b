"""Friction of the arm's own joints, behind their torque sensors.

In Dahl's model friction goes over to its level in the direction of the motion while a joint turns by some
mrad, and stays constant while the joint rests (P. Dahl, "Solid friction damping of mechanical vibrations",
AIAA Journal 14, 1976). So joints that a lift turns have friction in one direction or the other, and joints
that it does not turn keep for long what the last motion before the recording left in them.

The level of each joint follows from motions through free air, where no contact acts: the torque that
changes its sign where the joint reverses. It is fitted joint by joint, linear in

    tau = s tau_f + what grows with the angles (gravity that the model of the arm leaves)
                  + what grows with acceleration and squared speed (its inertia)

with the Dahl state s of the joint. This is the tau_f of w = (J^T)^+ (tau - tau_g - tau_f).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.load.observation import observe
from palpate.estimation.motion import Mask, smoothed
from palpate.geometry.pose import Array
from palpate.trace.samples import Samples, Trace, once

TURNED, LEFT = 0, 1
"""Last axis of `dahl_states`: direction of the last motion, and the rest of the initial friction."""


@once
def slip_states(samples: Samples) -> Array:
    """(n, m, 2 e) Dahl states of e elements, each with a presliding of its own.

    The friction of a joint is a sum of them (the generalised Maxwell slip model: Al-Bender, Lampaert and Swevers,
    IEEE Transactions on Automatic Control 50, 2005): over which way it turns round is learned with its level.
    """
    return dahl_states(samples.q, tuning.SLIPS)


def dahl_states(q: Array, presliding: Sequence[float] = (tuning.PRESLIDING,)) -> Array:
    """(n, m, 2 p) Dahl states for joint angles `q` (n, m), rad, at each presliding distance: direction of the last
    motion, -1 to 1, between them while the joint reverses; and the remaining share of the friction at the start,
    1 to 0."""
    # Means over some rows, the last over what remains.
    starts = np.arange(0, len(q), tuning.RUBBING_ROWS)
    counts = np.diff(np.append(starts, len(q)))
    blocks = np.add.reduceat(q, starts, axis=0) / counts[:, None]
    steps = np.apply_along_axis(_steps, 0, blocks)
    states = np.stack(dahl(steps, np.array(presliding)), axis=-1).reshape(*steps.shape, -1)
    return states[np.arange(len(q)) // tuning.RUBBING_ROWS]


def dahl(steps: Array, presliding: Array) -> tuple[Array, Array]:
    """Friction of unit level by Dahl's model, at p presliding distances: (n, m, p) that of joints which begin
    relaxed, and what is left of the friction at the start.

    Args:
        steps: (n, m) rad by which each joint turned.
        presliding: (p,), or (m, p) of each joint, rad: per rad a joint closes 1 / presliding of the way to its level.
    """
    keep = np.exp(-np.abs(steps)[:, :, None] / presliding)
    turned = np.copysign(1.0 - keep, steps[:, :, None])
    for row in range(1, len(steps)):
        turned[row] += keep[row] * turned[row - 1]
    return turned, np.multiply.accumulate(keep, axis=0)


def turned_round(friction: Array) -> Mask:
    """(m,) joints that turned both ways far enough to show their friction, by its Dahl states (n, m) over the largest
    presliding distance of `tuning.PRESLIDINGS`."""
    return (friction.max(axis=0) > tuning.TURNED) & (friction.min(axis=0) < -tuning.TURNED)


def _steps(q: Array) -> Array:
    """(k,) rad that a joint at angles `q` (k,) turned at each, beyond the play of its encoder."""
    # The play moves to clip(play, q - most, q + most). Two such clips in a row are one: so all up to each row,
    # twice as many at a time.
    most, reach = tuning.ENCODER_PLAY, 1
    low, high = q - most, q + most
    while reach < len(q):
        bounds = low[reach:], high[reach:]
        low[reach:], high[reach:] = np.clip(low[:-reach], *bounds), np.clip(high[:-reach], *bounds)
        reach *= 2
    return np.diff(np.clip(q[0], low, high), prepend=q[0])


def joint_ways(samples: Samples, empty: Mask, height: float) -> Array:
    """(n, m) direction of the last motion of each joint, with the presliding that its motions through free air
    show: states of several, averaged by how little each leaves (`joint_friction`)."""
    states = slip_states(samples)[:, :, TURNED :: LEFT + 1]
    usual = tuning.SLIPS.index(tuning.PRESLIDING)
    free, known = _free_motion(samples, states[:, :, usual], empty, height)
    if free.sum() < tuning.FREE_MOTION:
        return states[:, :, usual]
    # Least squares of all joints and states at once: each state beside what is orthogonal to `known`.
    axes, sizes, _ = np.linalg.svd(known, full_matrices=False)
    axes = axes[:, sizes > len(known) * np.finfo(float).eps * sizes[0]]

    def beyond(columns: Array) -> Array:
        return columns - axes @ (axes.T @ columns)

    found: list[Array] = []
    torques = beyond(samples.tau_ext[free])
    for way, tau in zip(states.transpose(1, 0, 2), torques.T, strict=True):
        ways = beyond(way[free])
        explained = (tau @ ways) ** 2 / np.maximum((ways**2).sum(axis=0), tuning.FLOOR**2)
        left = (tau @ tau - explained) / len(tau) + tuning.FLOOR**2
        # Likelihood with an unknown variance, of as many rows as are independent.
        likely = (left / left.min()) ** (-0.5 * len(tau) / tuning.CORRELATED_ROWS)
        found.append(way @ (likely / likely.sum()))
    return np.array(found).T


def _free_motion(samples: Samples, states: Array, empty: Mask, height: float) -> tuple[Mask, Array]:
    """Rows (n,) of motions of the `empty` hand above `height`, and columns (k, p) of what moving takes there."""

    def rate(values: Array, over: float) -> Array:
        rows = max(1, round(over / max(float(np.median(np.diff(samples.t))), 1e-9)))
        rates: Array = np.asarray(np.gradient(values, samples.t, axis=0))
        return np.column_stack([smoothed(one, rows) for one in rates.T])

    speed = rate(samples.q, tuning.SMOOTH)
    faster = rate(speed, 2 * tuning.SMOOTH)
    # Empty and high, after the arm has begun to move, and without jerks.
    free = empty & (samples.pose_world_tcp[:, 2] > height) & (np.abs(states).max(axis=1) > 0.5)
    free = free & (np.abs(faster).max(axis=1) < tuning.SLOWLY)
    angles = samples.q[free]
    angles = angles - angles.mean(axis=0) if len(angles) else angles
    ones = np.ones((len(angles), 1))
    return free, np.hstack([faster[free], speed[free] ** 2, ones, angles, angles**2])


def joint_friction(
    samples: Samples, states: Array, empty: Mask, height: float
) -> tuple[Array, Array]:
    """Friction level of each joint, (m,) N m, with standard deviations, from motions of the `empty` hand (n,)
    above `height`, m; `states` (n, m): direction of the last motion of each joint."""
    free, known = _free_motion(samples, states, empty, height)
    if free.sum() < tuning.FREE_MOTION:
        none = np.zeros(samples.q.shape[1])
        return none, none + tuning.JOINT_LEVEL
    torques = samples.tau_ext[free]
    found = [
        friction_level(known, way, tau) for way, tau in zip(states[free].T, torques.T, strict=True)
    ]
    mean, own = np.array(found).T
    return mean, np.hypot(tuning.JOINT_ERROR, own)


def friction_level(known: Array, way: Array, tau: Array) -> tuple[float, float]:
    """Coefficient of `way` (n,) beside those of the columns `known`, at least 0, and its standard deviation."""
    design = np.column_stack([way, known])
    # A joint that never reversed shows nothing: a prior in units of what a joint may have.
    prior = np.zeros(design.shape[1])
    prior[0] = tuning.JOINT_LEVEL**-2.0
    left = tau - design @ np.linalg.lstsq(design, tau, rcond=None)[0]
    # Variance of a mean of n residuals, times n: of white noise, or of slower noise where that is more.
    size = tuning.CORRELATED_ROWS
    whole = left[: len(left) // size * size].reshape(-1, size)
    scatter = max(float(left.var()), size * float(whole.mean(axis=1).var()), tuning.FLOOR**2)
    covariance = np.linalg.pinv(design.T @ design / scatter + np.diag(prior))
    found = covariance @ (design.T @ tau) / scatter
    return max(0.0, float(found[0])), float(np.sqrt(covariance[0, 0]))


def joint_friction_force(
    trace: Trace, rows: slice, free: Mask, empty: Mask, height: float
) -> Array:
    """(n,) N that joint friction adds to the pressing force of a guarded descent in `rows`.

    The hand moves straight down, but some joints reverse on the way through a compliant surface, and a
    constant joint torque is another force in another posture: of a force of 8 N that can be 1 N or more,
    rising with the depth like that of a spring. The linear trend over the rows in `free` air (n,) belongs to
    the baseline and is subtracted. 0 where the arm's chain is unknown.

    Args:
        empty: rows of the trace with an empty hand.
        height: m, world z of the TCP above which motions show the friction levels.
    """
    observed, samples = observe(trace), trace.samples
    if observed.chain is None:
        return np.zeros(len(free))
    states = joint_ways(samples, empty, height)
    level, _ = joint_friction(samples, states, empty, height)
    turning = level * states[rows]
    still = np.median((observed.signals[rows] - turning)[free], axis=0)
    seen = observed.wrenches(samples.q[rows])[:, 2, :]
    force: Array = -np.einsum("nm,nm->n", seen, turning + still).astype(np.float64)
    z: Array = samples.pose_world_tcp[rows, 2]
    if np.count_nonzero(free) < tuning.CURVE_ROWS or np.ptp(z[free]) == 0.0:
        # Too few rows for a line, or all at one height.
        return force - np.full(len(force), float(np.median(force[free])))
    rise, level_in_air = np.polyfit(z[free], force[free], 1).tolist()
    return force - (rise * z + level_in_air)
