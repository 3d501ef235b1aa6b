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

from palpate.common.pose import Array
from palpate.estimation.motion import Mask, smooth_rows
from palpate.estimation.wrench_observation import observe
from palpate.trace.samples import Samples, Trace, once

LEAST_TRAVEL = 0.7
"""part of its level that the slowest friction reaches, 12 mrad after a joint began to turn, in both directions where
a joint shows its friction: that of one that turns one way only is no other than an offset. Sensitive: no."""
CURVE_ROWS = 5
"""rows at least that make a line. Sensitive: no."""
SMOOTH = 0.02
"""s: forces are averaged over this before the breakaway is looked for. Sensitive: friction 2.1 σ, std ×0.9–1.8;
`static` 1.0 σ."""
PRESLIDING = 2e-3
"""rad over which the friction in a joint turns round: the usual order for harmonic drives. Sensitive: `static`
hardly, std ×0.9–1.1."""
SLIP_ANGLES = (4e-4, 2e-3, 1e-2)
"""rad, of the elements of which a joint's friction is a sum where a load is fitted: real arms show 1 to 4 mrad.
Sensitive: no."""
JOINT_ERROR = 0.03
"""N m (1 sigma): how well free motions show the friction behind a joint's sensor. Sensitive: friction 0.3 σ, std
×1.0–1.1."""
CORRELATED_ROWS = 20
"""rows, 0.1 s, of free motion in which what is left of a joint's torque is the same. Sensitive: hardly."""
SLOWLY = 0.5
"""rad/s²: a joint that changes its speed faster feels its inertia more than its friction. Sensitive: friction 0.2 σ."""
FREE_MOTION = 300
"""rows, 1.5 s, of motion through free air that show the friction of joints. Sensitive: no."""
JOINT_LEVEL = 0.3
"""N m (1 sigma) of the friction in a joint, behind its sensor: 0.15 to 0.64 were identified (Gaz et al., RA-L 2019,
doi:10.1109/LRA.2019.2931248). Sensitive: com 0.1 σ, std ×0.9–1.1."""
ENCODER_PLAY = 1e-5
"""rad of play, below which a change of a joint angle is encoder noise. Sensitive: no."""
RUBBING_ROWS = 4
"""rows, 20 ms, over whose mean angles a joint's motion is followed. Sensitive: no."""
FLOOR = 1e-4
"""N: noise that is always assumed, as perfect sensors make the equations singular. Sensitive: no."""

TURNED, LEFT = 0, 1
"""Last axis of `dahl_states`: direction of the last motion, and the rest of the initial friction."""


@once
def slip_states(samples: Samples) -> Array:
    """(n, m, 2 e) Dahl states of e elements, each with a presliding of its own.

    The friction of a joint is a sum of them (the generalised Maxwell slip model: Al-Bender, Lampaert and Swevers,
    IEEE Transactions on Automatic Control 50, 2005): over which way it turns round is learned with its level.
    """
    return dahl_states(samples.q, SLIP_ANGLES)


def dahl_states(q: Array, presliding: Sequence[float] = (PRESLIDING,)) -> Array:
    """(n, m, 2 p) Dahl states for joint angles `q` (n, m), rad, at each presliding distance: direction of the last
    motion, -1 to 1, between them while the joint reverses; and the remaining share of the friction at the start,
    1 to 0."""
    # Means over some rows, the last over what remains.
    starts = np.arange(0, len(q), RUBBING_ROWS)
    counts = np.diff(np.append(starts, len(q)))
    blocks = np.add.reduceat(q, starts, axis=0) / counts[:, None]
    steps = np.apply_along_axis(_steps, 0, blocks)
    states = np.stack(dahl(steps, np.array(presliding)), axis=-1).reshape(*steps.shape, -1)
    return states[np.arange(len(q)) // RUBBING_ROWS]


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
    presliding distance of `PRESLIDINGS`."""
    return (friction.max(axis=0) > LEAST_TRAVEL) & (friction.min(axis=0) < -LEAST_TRAVEL)


def _steps(q: Array) -> Array:
    """(k,) rad that a joint at angles `q` (k,) turned at each, beyond the play of its encoder."""
    # The play moves to clip(play, q - most, q + most). Two such clips in a row are one: so all up to each row,
    # twice as many at a time.
    most, reach = ENCODER_PLAY, 1
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
    usual = SLIP_ANGLES.index(PRESLIDING)
    free, known = _free_motion(samples, states[:, :, usual], empty, height)
    if free.sum() < FREE_MOTION:
        return states[:, :, usual]
    # Least squares of all joints and states at once: each state beside what is orthogonal to `known`.
    axes, sizes, _ = np.linalg.svd(known, full_matrices=False)
    axes = axes[:, sizes > len(known) * np.finfo(float).eps * sizes[0]]

    def excess_over_noise(columns: Array) -> Array:
        return columns - axes @ (axes.T @ columns)

    found: list[Array] = []
    torques = excess_over_noise(samples.tau_ext[free])
    for way, tau in zip(states.transpose(1, 0, 2), torques.T, strict=True):
        ways = excess_over_noise(way[free])
        explained = (tau @ ways) ** 2 / np.maximum((ways**2).sum(axis=0), FLOOR**2)
        left = (tau @ tau - explained) / len(tau) + FLOOR**2
        # Likelihood with an unknown variance, of as many rows as are independent.
        likely = (left / left.min()) ** (-0.5 * len(tau) / CORRELATED_ROWS)
        found.append(way @ (likely / likely.sum()))
    return np.array(found).T


def _free_motion(samples: Samples, states: Array, empty: Mask, height: float) -> tuple[Mask, Array]:
    """Rows (n,) of motions of the `empty` hand above `height`, and columns (k, p) of what moving takes there."""

    def rate(values: Array, over: float) -> Array:
        rows = max(1, round(over / max(float(np.median(np.diff(samples.t))), 1e-9)))
        rates: Array = np.asarray(np.gradient(values, samples.t, axis=0))
        return np.column_stack([smooth_rows(one, rows) for one in rates.T])

    speed = rate(samples.q, SMOOTH)
    faster = rate(speed, 2 * SMOOTH)
    # Empty and high, after the arm has begun to move, and without jerks.
    free = empty & (samples.pose_world_tcp[:, 2] > height) & (np.abs(states).max(axis=1) > 0.5)
    free = free & (np.abs(faster).max(axis=1) < SLOWLY)
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
    if free.sum() < FREE_MOTION:
        none = np.zeros(samples.q.shape[1])
        return none, none + JOINT_LEVEL
    torques = samples.tau_ext[free]
    found = [
        friction_level(known, way, tau) for way, tau in zip(states[free].T, torques.T, strict=True)
    ]
    mean, own = np.array(found).T
    return mean, np.hypot(JOINT_ERROR, own)


def friction_level(known: Array, way: Array, tau: Array) -> tuple[float, float]:
    """Coefficient of `way` (n,) beside those of the columns `known`, at least 0, and its standard deviation."""
    design = np.column_stack([way, known])
    # A joint that never reversed shows nothing: a prior in units of what a joint may have.
    prior = np.zeros(design.shape[1])
    prior[0] = JOINT_LEVEL**-2.0
    left = tau - design @ np.linalg.lstsq(design, tau, rcond=None)[0]
    # Variance of a mean of n residuals, times n: of white noise, or of slower noise where that is more.
    size = CORRELATED_ROWS
    whole = left[: len(left) // size * size].reshape(-1, size)
    scatter = max(float(left.var()), size * float(whole.mean(axis=1).var()), FLOOR**2)
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
    if np.count_nonzero(free) < CURVE_ROWS or np.ptp(z[free]) == 0.0:
        # Too few rows for a line, or all at one height.
        return force - np.full(len(force), float(np.median(force[free])))
    rise, level_in_air = np.polyfit(z[free], force[free], 1).tolist()
    return force - (rise * z + level_in_air)
