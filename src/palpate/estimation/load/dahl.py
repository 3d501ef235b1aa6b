"""Dahl friction states of the joints, behind their torque sensors, from the joint angles.

In Dahl's model friction goes over to its level in the direction of the motion while a joint turns by
some mrad, and stays where it is while the joint rests (P. Dahl, "Solid friction damping of mechanical
vibrations", AIAA Journal 14, 1976). So the joints that a lift turns rub one way or the other, and
those that it does not turn keep for long what the last motion before the recording left in them.
"""

from __future__ import annotations

import numpy as np

from palpate.estimation import tuning
from palpate.geometry.pose import Array

TURNED, LEFT = 0, 1
"""Of the last axis of `dahl_states`."""


def dahl_states(q: Array) -> Array:
    """(n, m, 2) of joint angles `q` (n, m), rad: which way each joint was turned last, -1 to 1,
    between them while it turns round; and what is left of the friction that it had at the start,
    1 to 0. What is less than `tuning.ENCODER_PLAY` is no motion."""
    steps = np.apply_along_axis(_steps, 0, _blocks(q))
    keep = np.exp(-np.abs(steps) / tuning.PRESLIDING)
    added = np.copysign(1.0 - keep, steps)
    states = np.empty((*steps.shape, 2))
    states[..., LEFT] = np.multiply.accumulate(keep, axis=0)
    for joint in range(q.shape[1]):
        states[:, joint, TURNED] = _followed(keep[:, joint], added[:, joint])
    return states[np.arange(len(q)) // tuning.RUBBING_ROWS]


def _steps(q: Array) -> Array:
    """(k,) rad that a joint at angles `q` (k,) turned at each, beyond the play of its encoder."""
    most, play = tuning.ENCODER_PLAY, float(q[0])
    found: list[float] = []
    # Numbers of Python: arrays of seven in a loop would take ten times as long.
    for angle in q.tolist():
        step = angle - play
        step -= min(max(step, -most), most)
        play += step
        found.append(step)
    return np.array(found)


def _followed(keep: Array, added: Array) -> Array:
    """(k,) what is left, of each step `keep`, of all that was `added` until then."""
    state = 0.0
    found: list[float] = []
    for share, more in zip(keep.tolist(), added.tolist(), strict=True):
        state = share * state + more
        found.append(state)
    return np.array(found)


def _blocks(q: Array) -> Array:
    """(k, m) means over `tuning.RUBBING_ROWS` rows; the last one over what is left."""
    starts = np.arange(0, len(q), tuning.RUBBING_ROWS)
    sums = np.add.reduceat(q, starts, axis=0)
    counts = np.diff(np.append(starts, len(q)))
    return sums / counts[:, None]
