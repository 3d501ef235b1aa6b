"""What the arm's own joints add to the force of a guarded descent.

The hand goes straight down, but not every joint goes one way: on the way through what gives way some turn
round, and their friction with them; and what joints feel in free air is another force in another posture.
In a force of 8 N that can be 1 N or more, which rises with the depth as a spring's would. How much each joint
rubs, the arm's own motions through free air show (`friction.joints`).
"""

from __future__ import annotations

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.friction.joints import joint_friction
from palpate.estimation.load.feeling import feeling
from palpate.estimation.load.rubbing import TURNED, rubbing
from palpate.estimation.windows import Mask, load_of
from palpate.geometry.pose import Array
from palpate.trace.once import once
from palpate.trace.samples import Samples, Trace


def rubbed(trace: Trace, rows: slice, free: Mask, height: float) -> Array:
    """(n,) N that it adds to the pressing force in some rows of a trace, beyond the line through what it adds
    to it in those (n,) in free air, which is free air's own; by what the arm's motions above `height` (world
    z of the TCP, m) and those rows show. 0 where it is not known how joint torques made the force."""
    felt, samples = feeling(trace), trace.samples
    if felt.chain is None:
        return np.zeros(len(free))
    ways = _ways(samples)
    level, _ = joint_friction(samples, ways, load_of(trace, None), height)
    turning = level * ways[rows]
    still = np.median((felt.signals[rows] - turning)[free], axis=0)
    seen = np.linalg.pinv(felt.maps(samples.q[rows]))[:, 2, :]
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
    """(n, m) which way each joint was turned last."""
    return rubbing(samples.q)[:, :, TURNED]
