"""The friction in an arm's joints, behind their sensors, as far as their motion tells of it.

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
"""Of the last axis of `rubbing`."""


def rubbing(q: Array) -> Array:
    """(n, m, 2) of joint angles `q` (n, m), rad: which way each joint was turned last, -1 to 1,
    between them while it turns round; and what is left of the friction that it had at the start,
    1 to 0. What is less than `tuning.ENCODER_PLAY` is no motion."""
    coarse = _blocks(q)
    play = coarse[0].copy()
    states = np.zeros((len(coarse), q.shape[1], 2))
    states[0, :, LEFT] = 1.0
    for row in range(1, len(coarse)):
        step = coarse[row] - play
        step -= np.clip(step, -tuning.ENCODER_PLAY, tuning.ENCODER_PLAY)
        play += step
        keep = np.exp(-np.abs(step) / tuning.PRESLIDING)
        states[row] = keep[:, None] * states[row - 1]
        states[row, :, TURNED] += np.copysign(1.0 - keep, step)
    return states[np.arange(len(q)) // tuning.RUBBING_ROWS]


def _blocks(q: Array) -> Array:
    """(k, m) means over `tuning.RUBBING_ROWS` rows; the last one over what is left."""
    starts = np.arange(0, len(q), tuning.RUBBING_ROWS)
    sums = np.add.reduceat(q, starts, axis=0)
    counts = np.diff(np.append(starts, len(q)))
    return sums / counts[:, None]
