"""Rows of a trace in free air: only the load and the arm's own links act."""

from __future__ import annotations

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.windows import Load, Mask, row_at, runs
from palpate.trace.samples import Trace

TOUCHING = ("contact", "sliding")


def apart(trace: Trace) -> Mask:
    """Rows in which the hand is away from where a leaf began or ended touching something, and no
    leaf that does both is at work."""
    t, position = trace.samples.t, trace.samples.pose_world_tcp[:, :3]
    found = np.ones(len(t), dtype=bool)
    touched = False
    leaves = sorted(trace.leaves, key=lambda run: run.end)
    for leaf, until in zip(leaves, [*(other.start for other in leaves[1:]), np.inf], strict=True):
        touches = leaf.context is not None and leaf.context.activity in TOUCHING
        rows = (t >= leaf.start) & (t < max(until, leaf.end))
        if touched and touches:
            found[rows] = False
        elif touched or touches:
            place = position[row_at(trace.samples, leaf.start if touched else leaf.end)]
            found[rows] &= np.linalg.norm(position[rows] - place, axis=1) > tuning.FREE_ABOVE
        touched = touches
    return found


def lifted(trace: Trace, load: Load, above: float = tuning.FREE_ABOVE) -> Mask:
    """Rows in which the hand is higher than where it took the object by so many m `above`."""
    z = trace.samples.pose_world_tcp[:, 2]
    found = np.zeros(len(z), dtype=bool)
    for rows in runs(load.loaded):
        found[rows] = z[rows] > z[rows.start] + above
    return found
