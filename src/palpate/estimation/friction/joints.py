"""Friction of the arm's own joints, from motions through free air.

An arm that moves with empty fingers feels no contact; what turns round in the torque of a joint
where the joint turns round is friction behind its sensor. The joints of a real arm are fitted one by
one, linear in

    tau = s tau_f + what grows with the angles (gravity that the model of the arm leaves)
                  + what grows with acceleration and squared speed (its inertia)

with s which way the joint was turned last (`load.dahl`). This is the tau_f of w = (J^T)^+ (tau - tau_g -
tau_f).
"""

from __future__ import annotations

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.windows import Load, Mask, smoothed
from palpate.geometry.pose import Array
from palpate.trace.samples import Samples


def joint_friction(samples: Samples, ways: Array, load: Load, height: float) -> tuple[Array, Array]:
    """Friction level of each joint, (7,) N m, with standard deviations, from motions of the empty
    hand above `height`, m; `ways` (n, 7) are the Dahl states."""
    speed = _rate(samples.q, samples.t, tuning.SMOOTH)
    faster = _rate(speed, samples.t, 2 * tuning.SMOOTH)
    free = _free(samples, ways, load, height) & (np.abs(faster).max(axis=1) < tuning.SLOWLY)
    if free.sum() < tuning.FREE_MOTION:
        none = np.zeros(samples.q.shape[1])
        return none, none + tuning.JOINT_LEVEL
    angles = samples.q[free] - samples.q[free].mean(axis=0)
    ones = np.ones((len(angles), 1))
    known = np.hstack([faster[free], speed[free] ** 2, ones, angles, angles**2])
    torques = samples.tau_ext[free]
    found = [_turning(known, way, tau) for way, tau in zip(ways[free].T, torques.T, strict=True)]
    mean, own = np.array(found).T
    return mean, np.hypot(tuning.JOINT_ERROR, own)


def _free(samples: Samples, ways: Array, load: Load, height: float) -> Mask:
    """Rows in which the hand is empty and high, and the arm has moved before."""
    high = samples.pose_world_tcp[:, 2] > height
    begun = np.abs(ways).max(axis=1) > 0.5
    return load.empty & high & begun


def _rate(values: Array, t: Array, over: float) -> Array:
    """(n, k) change a second of values (n, k), averaged over so many s."""
    rows = max(1, round(over / max(float(np.median(np.diff(t))), 1e-9)))
    rates: Array = np.asarray(np.gradient(values, t, axis=0))
    return np.column_stack([smoothed(rate, rows) for rate in rates.T])


def _turning(known: Array, way: Array, tau: Array) -> tuple[float, float]:
    """The coefficient of `way` beside those of the columns that are `known`, not below 0, and its
    standard deviation."""
    design = np.column_stack([way, known])
    # In units of what a joint may have: a joint that never turned round shows nothing.
    prior = np.zeros(design.shape[1])
    prior[0] = tuning.JOINT_LEVEL**-2.0
    scatter = _scatter(tau - design @ np.linalg.lstsq(design, tau, rcond=None)[0])
    covariance = np.linalg.pinv(design.T @ design / scatter + np.diag(prior))
    found = covariance @ (design.T @ tau) / scatter
    return max(0.0, float(found[0])), float(np.sqrt(covariance[0, 0]))


def _scatter(left: Array) -> float:
    """(N m)², variance that the mean of n rows of what is left has, times n: white noise and what is
    slower."""
    size = tuning.CORRELATED_ROWS
    whole = left[: len(left) // size * size].reshape(-1, size)
    return max(float(left.var()), size * float(whole.mean(axis=1).var()), tuning.FLOOR**2)
