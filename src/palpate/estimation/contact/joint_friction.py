"""Joint friction in the force of a guarded descent.

The hand moves straight down, but some joints reverse on the way through a compliant surface, and their friction
with them; and a constant joint torque is another force in another posture. Of a force of 8 N that can be 1 N or
more, rising with the depth like a spring's. The friction level of each joint is estimated from motions in
free air (`friction.joints`).
"""

from __future__ import annotations

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.friction.joints import joint_friction
from palpate.estimation.load.dahl import TURNED, dahl_states
from palpate.estimation.load.observation import observe
from palpate.estimation.windows import Mask, load_of
from palpate.geometry.pose import Array
from palpate.trace.samples import Samples, Trace, once


def joint_friction_force(trace: Trace, rows: slice, free: Mask, height: float) -> Array:
    """(n,) N that joint friction adds to the pressing force in `rows`, less its linear trend over the rows
    in `free` air (n,), which belongs to the baseline. Friction levels are estimated from motions above `height`
    (world z of the TCP, m). 0 where the arm's chain is unknown."""
    observed, samples = observe(trace), trace.samples
    if observed.chain is None:
        return np.zeros(len(free))
    ways = _ways(samples)
    level, _ = joint_friction(samples, ways, load_of(trace, None), height)
    turning = level * ways[rows]
    still = np.median((observed.signals[rows] - turning)[free], axis=0)
    seen = np.linalg.pinv(observed.maps(samples.q[rows]))[:, 2, :]
    force = -np.einsum("nm,nm->n", seen, turning + still).astype(np.float64)
    return force - _line(samples.pose_world_tcp[rows, 2], force, free)


def _line(z: Array, force: Array, free: Mask) -> Array:
    """(n,) N, the line over the height (n,) through the rows in free air; level of few rows, or of one height."""
    if np.count_nonzero(free) < tuning.CURVE_ROWS or np.ptp(z[free]) == 0.0:
        return np.full(len(force), float(np.median(force[free])))
    rise, level = np.polyfit(z[free], force[free], 1).tolist()
    return rise * z + level


@once
def _ways(samples: Samples) -> Array:
    """(n, m) Dahl state of each joint: direction of its last motion, -1 to 1."""
    return dahl_states(samples.q)[:, :, TURNED]
