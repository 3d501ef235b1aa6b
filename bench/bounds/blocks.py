"""A recorded motion in blocks, each long enough that white noise averages out and short enough that
nothing moves far."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.estimation.load.observation import observe
from palpate.estimation.motion import Mask, acceleration
from palpate.geometry.pose import Array
from palpate.trace.samples import Trace

BLOCK = 0.1
"""s."""
SMOOTH = 0.05
"""s over which an acceleration is taken."""


@dataclass(frozen=True, slots=True, eq=False)
class Blocks:
    """Means of a trace over `BLOCK` s.

    Attributes:
        place: (rows,) of each sample the block that it is in.
        rows: (n,) samples in each block.
        t: (n,) s.
        q, dq: (n, 7) rad, rad/s.
        position: (n, 3) m of the TCP, world.
        rotation: (n, 3, 3) the tool's axes in the world.
        acceleration: (n, 3) m/s² of the TCP, world.
        maps: (n, 7, 6) joint torques of unit wrenches, world axes about the TCP.
        turn: (3, 3) the base's axes in the world.
    """

    place: NDArray[np.intp]
    rows: Array
    t: Array
    q: Array
    dq: Array
    position: Array
    rotation: Array
    acceleration: Array
    maps: Array
    turn: Array

    def mean(self, signal: Array) -> Array:
        """Of a signal (rows, ...), block by block."""
        sums = np.zeros((len(self.rows), *signal.shape[1:]))
        np.add.at(sums, self.place, signal)
        return sums / self.rows.reshape(-1, *[1] * (signal.ndim - 1))

    def all(self, mask: Mask) -> Mask:
        """(n,) blocks of which every row is in the mask (rows,)."""
        return self.mean(mask.astype(float)) > 1.0 - 1e-9


def blocks(trace: Trace) -> Blocks | None:
    """The trace in blocks; None where it does not say what joint torques come from."""
    observed, samples = observe(trace), trace.samples
    if observed.chain is None:
        return None
    _, place = np.unique(((samples.t - samples.t[0]) / BLOCK).astype(int), return_inverse=True)
    rows = np.bincount(place).astype(float)
    middle = np.searchsorted(place, np.arange(len(rows))) + (rows // 2).astype(int)
    q = samples.q[middle]
    return Blocks(
        place,
        rows,
        samples.t[middle],
        q,
        samples.dq[middle],
        samples.pose_world_tcp[middle, :3],
        _rotations(samples.pose_world_tcp[middle, 3:]),
        acceleration(samples, SMOOTH)[middle],
        observed.maps(q),
        observed.turn,
    )


def _rotations(quaternions: Array) -> Array:
    """(n, 3, 3) of unit quaternions wxyz (n, 4)."""
    w, x, y, z = quaternions.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)
