"""A motion's set-points, computed once for all its 1 ms steps."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from palpate.pose import Array, Pose
from palpate.robots.impedance import Gains
from palpate.robots.trajectory import Path, PosePath, turned
from palpate.robots.world import BLOCK, TIMESTEP

LONGEST_RUN = 8
"""Log periods that pass between two updates of the feed-forward torques, at most: 25 Hz."""


class Setpoints:
    """Rows of a path, ready to slice; after its end the last one stays.

    Attributes:
        path: what they are of.
    """

    def __init__(self, path: Path | PosePath, start: float, rows: Array, poses: Array) -> None:
        """Of `path` from time `start`, s, on: set-points (m, k) of each step and the commanded poses (m / 5, 7)."""
        self.path, self._start, self._rows, self._poses = path, start, rows, poses
        self._end = len(rows) - LONGEST_RUN * BLOCK

    def take(self, t: float, n: int) -> tuple[Array, Array]:
        """Set-points of the next `n` steps after time `t`, and the commanded poses of their log periods (n / 5, 7)."""
        first = min(round((t - self._start) / TIMESTEP), self._end)
        block = first // BLOCK
        return self._rows[first:first + n], self._poses[block:block + n // BLOCK]


def joint_setpoints(path: Path, start: float, gains: Gains, poses: Callable[[Array], Array]) -> Setpoints:
    """For the joints' springs; `poses` makes TCP poses (n, 7) of configurations (n, 7)."""
    rows = path.sample(_times(path, start))
    return Setpoints(path, start, rows + _lead(rows, gains), poses(rows[BLOCK // 2::BLOCK]))


def pose_setpoints(path: PosePath, start: float, gains: Gains) -> Setpoints:
    """For the TCP's springs."""
    rows = path.path.sample(_times(path.path, start))
    # rotation vectors are in the origin's frame, the springs in the world's
    rotation = Pose(np.zeros(3), path.origin).rotation
    to_world = np.kron(np.eye(2), np.eye(3))
    to_world[3:, 3:] = rotation
    led = rows + _lead(rows @ to_world.T, gains) @ to_world
    return Setpoints(path, start, _poses(path.origin, led), _poses(path.origin, rows[BLOCK // 2::BLOCK]))


def _times(path: Path, start: float) -> Array:
    """Every step from `start` to the path's end, in whole blocks, and one more run."""
    blocks = max(0, int(np.ceil((path.end - start) / (BLOCK * TIMESTEP) - 1e-9)))
    return start + TIMESTEP * np.arange(1, (blocks + LONGEST_RUN) * BLOCK + 1)


def _lead(rows: Array, gains: Gains) -> Array:
    rate = np.gradient(rows, TIMESTEP, axis=0)
    return gains.lead(rate, np.gradient(rate, TIMESTEP, axis=0))


def _poses(origin: Array, coordinates: Array) -> Array:
    return np.concatenate([coordinates[:, :3], turned(origin, coordinates[:, 3:])], axis=1)
