"""A motion's set-points, computed once for all its 1 ms steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from palpate.geometry.pose import Array, Pose
from palpate.robots.simulated.impedance import Gains
from palpate.robots.simulated.timing import BLOCK, LONGEST_RUN, PERIOD, TIMESTEP
from palpate.robots.trajectory.path import Path
from palpate.robots.trajectory.posed import PosePath, turned


@dataclass(frozen=True, slots=True, eq=False)
class Setpoints:
    """Rows of a path, ready to slice; after its end the last one stays.

    Attributes:
        path: what they are of.
        start: its beginning, s.
        rows: (m, k) set-points of each step.
        poses: (m / 5, 7) commanded poses of each log period.
        posture: (m / 5, 14) where the null space shall be and how fast it moves, at the beginning
            of each log period.
    """

    path: Path | PosePath
    start: float
    rows: Array
    poses: Array
    posture: Array

    def first(self, t: float) -> int:
        """The step that begins at time `t`."""
        return min(round((t - self.start) / TIMESTEP), len(self.rows) - LONGEST_RUN * BLOCK)


def joint_setpoints(
    path: Path, start: float, gains: Gains, poses: Callable[[Array], Array]
) -> Setpoints:
    """For the joints' springs; `poses` makes TCP poses (n, 7) of configurations (n, 7)."""
    rows = path.sample(_times(path, start))
    poses_world_tcp = poses(rows[BLOCK // 2 :: BLOCK])
    return Setpoints(
        path, start, rows + _lead(rows, gains), poses_world_tcp, np.empty((len(poses_world_tcp), 0))
    )


def pose_setpoints(path: PosePath, posture: Path, start: float, gains: Gains) -> Setpoints:
    """For the TCP's springs, with a joint path for the null space."""
    times = _times(path.path, start)
    rows, configurations = path.path.sample(times), posture.sample(times[::BLOCK])
    rates = np.gradient(configurations, PERIOD, axis=0)
    # rotation vectors are in the origin's frame, the springs in the world's
    rotation = Pose(np.zeros(3), path.origin).rotation
    to_world = np.eye(6)
    to_world[3:, 3:] = rotation
    led = rows + _lead(rows @ to_world.T, gains) @ to_world
    return Setpoints(
        path,
        start,
        _poses(path.origin, led),
        _poses(path.origin, rows[BLOCK // 2 :: BLOCK]),
        np.concatenate([configurations, rates], axis=1),
    )


def _times(path: Path, start: float) -> Array:
    """Every step from `start` to the path's end, in whole blocks, and one more run."""
    blocks = max(0, int(np.ceil((path.end - start) / PERIOD - 1e-9)))
    return start + TIMESTEP * np.arange(1.0, (blocks + LONGEST_RUN) * BLOCK + 1)


def _lead(rows: Array, gains: Gains) -> Array:
    rate = np.gradient(rows, TIMESTEP, axis=0)
    return gains.lead(rate, np.gradient(rate, TIMESTEP, axis=0))


def _poses(origin: Array, coordinates: Array) -> Array:
    return np.concatenate([coordinates[:, :3], turned(origin, coordinates[:, 3:])], axis=1)
