"""Ripple of the arm's gears in a force: a wave in the angle of each joint, known number of times a turn.

    tau = a + b q + sum_h [c_h sin(h n q) + s_h cos(h n q)],    h = 1, 2

with n cycles a turn of harmonic drives, fitted joint by joint in free air. Some mm of contact are less than one wave,
which there looks like a spring; from several waves before, it goes on.
"""

from __future__ import annotations

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.load.observation import observe
from palpate.estimation.motion import Mask
from palpate.geometry.pose import Array
from palpate.trace.samples import Trace


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
    count = free.sum() / tuning.CORRELATED_ROWS
    gained = count * np.log(left[0] @ left[0] / max(left[1] @ left[1], tuning.FLOOR**2))
    if gained < 2.0 * waves.shape[1]:
        return np.zeros(len(q))
    ripple: Array = (waves @ found[line.shape[1] :]).astype(np.float64)
    return ripple


def gear_waves(angle: Array, cycles: float) -> Array:
    """(n, 4) unit waves of a gear at a joint's angles (n,), rad: sines and cosines of two harmonics."""
    phases = cycles * np.outer(angle, (1.0, 2.0))
    return np.hstack([np.sin(phases), np.cos(phases)])
