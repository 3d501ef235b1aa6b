"""Friction of the arm's own joints, behind their torque sensors.

In Dahl's model the friction approaches its level in the direction of the motion while a joint turns by some mrad. It
stays constant while the joint rests (P. Dahl, "Solid friction damping of mechanical vibrations", AIAA Journal 14,
1976). Joints that a lift turns thus have friction in one direction or the other. Joints that it does not turn keep the
friction of the last motion before the recording for a long time.

The level of each joint follows from motions through free air, where no contact acts: the torque that changes its sign
where the joint reverses. It is fitted joint by joint, linear in

    tau = s tau_f + terms in the angles (gravity errors of the arm's model)
                  + terms in acceleration and squared speed (its inertia)

with the Dahl state s of the joint. This is the tau_f of w = (J^T)^+ (tau - tau_g - tau_f).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.common.pose import Array
from palpate.estimation.evidence import once
from palpate.estimation.motion import Mask, smooth_rows
from palpate.estimation.wrench_observation import observe_wrench
from palpate.trace.samples import Samples, Trace

LEAST_TRAVEL = 0.7
"""fraction of its level that the slowest friction must reach in both directions, 12 mrad after a joint began to turn.
The friction of a joint that turns one way only looks like an offset. Not sensitive."""
CURVE_ROWS = 5
"""rows: fewest for a line. Not sensitive."""
SMOOTH = 0.02
"""s: averaging time of forces before the search for the breakaway. Sensitive: friction 2.1 σ, std
×0.9–1.8; `static` 1.0 σ."""
PRESLIDING = 2e-3
"""rad over which the friction in a joint reverses; the usual order for harmonic drives. Sensitive:
`static` hardly, its std ×0.9–1.1."""
SLIP_ANGLES = (4e-4, 2e-3, 1e-2)
"""rad: presliding of the elements whose sum is a joint's friction in a load fit. Real arms show 1
to 4 mrad. Not sensitive."""
JOINT_ERROR = 0.03
"""N m (1 sigma): error of the friction behind a joint's sensor as estimated from free motions.
Sensitive: friction 0.3 σ, std ×1.0–1.1."""
CORRELATED_ROWS = 20
"""rows (0.1 s): correlation length of a joint torque's residual in free motion. Hardly sensitive."""
SLOWLY = 0.5
"""rad/s²: above this acceleration the inertia of a joint exceeds its friction. Sensitive: friction
0.2 σ."""
FREE_MOTION = 300
"""rows (1.5 s): least motion through free air from which joint friction is estimated. Not sensitive."""
JOINT_LEVEL = 0.3
"""N m (1 sigma): friction in a joint behind its sensor; 0.15 to 0.64 were identified (Gaz et al.,
RA-L 2019, doi:10.1109/LRA.2019.2931248). Sensitive: com 0.1 σ, std ×0.9–1.1."""
ENCODER_PLAY = 1e-5
"""rad of play: a smaller change of a joint angle is encoder noise. Not sensitive."""
RUBBING_ROWS = 4
"""rows (20 ms): block length of the mean angles that follow a joint's motion. Not sensitive."""
FLOOR = 1e-4
"""N: noise that is always assumed, as perfect sensors make the equations singular. Not sensitive."""

TURNED, LEFT = 0, 1
"""Last axis of `dahl_states`: direction of the last motion, and remaining share of the initial friction."""


@once
def slip_states(samples: Samples) -> Array:
    """Compute the (n, m, 2 e) Dahl states of e elements with different presliding distances.

    The friction of a joint is a sum of them (generalised Maxwell slip model: Al-Bender, Lampaert and Swevers, IEEE
    Transactions on Automatic Control 50, 2005). Its presliding distance is learned with its level.
    """
    return dahl_states(samples.q, SLIP_ANGLES)


def dahl_states(q: Array, presliding: Sequence[float] = (PRESLIDING,)) -> Array:
    """Compute the (n, m, 2 p) Dahl states at joint angles `q` (n, m), rad, for each presliding distance, rad.

    The first state is the direction of the last motion, -1 to 1; it changes gradually while the joint reverses. The
    second is the remaining share of the friction at the start, 1 to 0.
    """
    # Mean angles of blocks; the last block holds the remaining rows.
    starts = np.arange(0, len(q), RUBBING_ROWS)
    counts = np.diff(np.append(starts, len(q)))
    blocks = np.add.reduceat(q, starts, axis=0) / counts[:, None]
    # Steps beyond encoder noise drive Dahl's model; each block's state holds in all its rows.
    steps = np.apply_along_axis(_steps, 0, blocks)
    states = np.stack(dahl(steps, np.array(presliding)), axis=-1).reshape(*steps.shape, -1)
    return states[np.arange(len(q)) // RUBBING_ROWS]


def dahl(steps: Array, presliding: Array) -> tuple[Array, Array]:
    """Integrate Dahl's model of unit level: (n, m, p) friction of initially relaxed joints, and
    remaining share of the initial friction.

    Args:
        steps: (n, m) rad by which each joint turned.
        presliding: (p,), or (m, p) of each joint, rad: distance over which 1 - 1/e of the way to
            the level is covered.
    """
    # A step keeps a share of the old friction and adds the rest in its own direction.
    keep = np.exp(-np.abs(steps)[:, :, None] / presliding)
    turned = np.copysign(1.0 - keep, steps[:, :, None])
    for row in range(1, len(steps)):
        turned[row] += keep[row] * turned[row - 1]
    return turned, np.multiply.accumulate(keep, axis=0)


def turned_round(friction: Array) -> Mask:
    """Find the joints (m,) that turned far enough in both directions to show their friction.

    The Dahl states (n, m) are those of the largest presliding distance of `SLIP_ANGLES`.
    """
    return (friction.max(axis=0) > LEAST_TRAVEL) & (friction.min(axis=0) < -LEAST_TRAVEL)


def _steps(q: Array) -> Array:
    """Compute the steps (k,), rad, of a joint at angles `q` (k,), beyond the play of its encoder."""
    # The play moves to clip(play, q - most, q + most). Two such clips in a row are one: compose all
    # clips up to each row by doubling.
    most, reach = ENCODER_PLAY, 1
    low, high = q - most, q + most
    while reach < len(q):
        bounds = low[reach:], high[reach:]
        low[reach:], high[reach:] = np.clip(low[:-reach], *bounds), np.clip(high[:-reach], *bounds)
        reach *= 2
    return np.diff(np.clip(q[0], low, high), prepend=q[0])


def joint_ways(samples: Samples, empty: Mask, height: float) -> Array:
    """Estimate the direction (n, m) of the last motion of each joint, with the presliding that its free motions show.

    The directions for several presliding distances are averaged by their likelihood, see
    `joint_friction`.
    """
    states = slip_states(samples)[:, :, TURNED :: LEFT + 1]
    usual = SLIP_ANGLES.index(PRESLIDING)
    free, known = _free_motion(samples, states[:, :, usual], empty, height)
    if free.sum() < FREE_MOTION:
        return states[:, :, usual]
    axes = _column_space(known)
    found: list[Array] = []
    torques = _project_out(axes, samples.tau_ext[free])
    for way, tau in zip(states.transpose(1, 0, 2), torques.T, strict=True):
        ways = _project_out(axes, way[free])
        # Residual variance of the torque with each presliding distance.
        explained = (tau @ ways) ** 2 / np.maximum((ways**2).sum(axis=0), FLOOR**2)
        left = (tau @ tau - explained) / len(tau) + FLOOR**2
        # Likelihood with an unknown variance, and the number of independent rows.
        likely = (left / left.min()) ** (-0.5 * len(tau) / CORRELATED_ROWS)
        found.append(way @ (likely / likely.sum()))
    return np.array(found).T


def _column_space(columns: Array) -> Array:
    """Compute orthonormal axes (n, r) of the space of the columns (n, p) of rank r."""
    axes, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    return axes[:, sizes > len(columns) * np.finfo(float).eps * sizes[0]]


def _project_out(axes: Array, columns: Array) -> Array:
    """Subtract from columns (n, k) their parts in the space of orthonormal `axes` (n, r)."""
    return columns - axes @ (axes.T @ columns)


@once
def _rates(samples: Samples) -> Array:
    """Compute joint speeds, rad/s, and accelerations, rad/s², by smoothed differences: (2, n, m)."""

    def rate(values: Array, over: float) -> Array:
        rows = max(1, round(over / max(float(np.median(np.diff(samples.t))), 1e-9)))
        rates: Array = np.asarray(np.gradient(values, samples.t, axis=0))
        return np.column_stack([smooth_rows(one, rows) for one in rates.T])

    speed = rate(samples.q, SMOOTH)
    return np.array([speed, rate(speed, 2 * SMOOTH)])


def _free_motion(samples: Samples, states: Array, empty: Mask, height: float) -> tuple[Mask, Array]:
    """Select the rows (n,) of free motion of the `empty` hand above `height`, and their nuisance columns (k, p).

    The columns are acceleration, squared speed, a constant, the angles and their squares.
    """
    speed, faster = _rates(samples)
    # The hand is empty and high, the arm has begun to move, and moves without jerks.
    free = empty & (samples.pose_world_tcp[:, 2] > height) & (np.abs(states).max(axis=1) > 0.5)
    free = free & (np.abs(faster).max(axis=1) < SLOWLY)
    angles = samples.q[free]
    angles = angles - angles.mean(axis=0) if len(angles) else angles
    ones = np.ones((len(angles), 1))
    return free, np.hstack([faster[free], speed[free] ** 2, ones, angles, angles**2])


def joint_friction(
    samples: Samples, states: Array, empty: Mask, height: float
) -> tuple[Array, Array]:
    """Estimate the friction level of each joint, (m,) N m, and standard deviations, from free motions.

    Args:
        states: (n, m) direction of the last motion of each joint.
        empty: (n,) rows with an empty hand.
        height: m, world z of the TCP above which motions count.
    """
    free, known = _free_motion(samples, states, empty, height)
    if free.sum() < FREE_MOTION:
        # Too little free motion: the prior.
        none = np.zeros(samples.q.shape[1])
        return none, none + JOINT_LEVEL
    # Project out the nuisance columns: one factorisation serves all joints.
    axes = _column_space(known)
    ways, torques = _project_out(axes, states[free]), _project_out(axes, samples.tau_ext[free])
    sizes, shared = (ways**2).sum(axis=0), (ways * torques).sum(axis=0)
    left = torques - ways * (shared / np.maximum(sizes, FLOOR**2))
    # Residual variance: of single rows, or of block means times the block length where slower noise dominates.
    size = CORRELATED_ROWS
    means = left[: len(left) // size * size].reshape(-1, size, left.shape[1]).mean(axis=1)
    scatter = np.maximum(left.var(axis=0), size * means.var(axis=0)).clip(FLOOR**2)
    # Posterior, at least 0. Without a reversal the prior of the usual friction remains.
    variance = 1.0 / (sizes / scatter + JOINT_LEVEL**-2.0)
    mean = np.maximum(variance * shared / scatter, 0.0)
    return mean, np.hypot(JOINT_ERROR, np.sqrt(variance))


def joint_friction_force(
    trace: Trace, rows: slice, free: Mask, empty: Mask, height: float
) -> Array:
    """Compute the part (n,), N, of the pressing force in a guarded descent that joint friction causes.

    The hand moves straight down, but some joints reverse in a compliant surface. A constant joint torque is also
    another force in another posture. For a force of 8 N this can be 1 N or more, and it rises with the depth like the
    force of a spring. The linear trend over the rows in `free` air (n,) belongs to the baseline and is subtracted. The
    result is 0 where the arm's chain is unknown.

    Args:
        rows: of the descent.
        free: (n,) those in free air.
        empty: rows of the trace with an empty hand.
        height: m, world z of the TCP above which motions show the friction levels.
    """
    observed, samples = observe_wrench(trace), trace.samples
    if observed.chain is None:
        return np.zeros(len(free))
    # Friction torque of each joint in the descent, and its constant remainder in free air.
    states = joint_ways(samples, empty, height)
    level, _ = joint_friction(samples, states, empty, height)
    turning = level * states[rows]
    still = np.median((observed.signals[rows] - turning)[free], axis=0)
    # Map both to the pressing force, and subtract its line in free air.
    seen = observed.wrenches(samples.q[rows])[:, 2, :]
    force: Array = -np.einsum("nm,nm->n", seen, turning + still).astype(np.float64)
    z: Array = samples.pose_world_tcp[rows, 2]
    if np.count_nonzero(free) < CURVE_ROWS or np.ptp(z[free]) == 0.0:
        # Too few rows for a line, or all at one height.
        return force - np.full(len(force), float(np.median(force[free])))
    rise, level_in_air = np.polyfit(z[free], force[free], 1).tolist()
    return force - (rise * z + level_in_air)
