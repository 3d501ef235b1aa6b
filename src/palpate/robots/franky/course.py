"""A commanded motion as a table: the equilibrium in each control cycle after its beginning.

A course has its own clock, which begins when the arm first follows it and never runs faster than
the robot's: after a stall of this computer the reference continues from where it was.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.geometry.pose import Array, Pose
from palpate.robots.franky.library import franky
from palpate.robots.nominal import NominalArm
from palpate.robots.trajectory import Path, PosePath, quaternion_matrix, turned

CYCLE = 0.001  # s of a control cycle
COARSE = 5  # cycles between two logged target poses of a joint motion


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """A motion's references in the base's frame."""

    path: Path | PosePath  # its time begins at 0
    posture: Array | None  # (7,) rad, goal of the null space in a Cartesian motion
    rows: Array  # (m, 7) joint positions, or positions and quaternions xyzw
    rates: Array  # (m, 7) rad/s, or (m, 6) twists
    poses_world_tcp: Array  # (k, 7) commanded TCP poses, one each `every` rows
    every: int

    @property
    def last(self) -> int:
        """Row in which it has come to rest."""
        return len(self.rows) - 1

    def reference(self, clock: float) -> Any:
        """Return franky's reference `clock` s after the beginning."""
        i, module = self.row(clock), franky()
        row, rate = self.rows[i], self.rates[i]
        if self.posture is None:
            return module.JointReference(q=row, dq=rate)
        twist = module.Twist(rate[:3], rate[3:])
        return module.CartesianReference(module.Affine(row[:3], row[3:]), twist)

    def row(self, clock: float) -> int:
        """Return the index of the row that is due."""
        return min(round(clock / CYCLE), self.last)

    def target(self, clock: float) -> Array:
        """Return the commanded pose (7,) of the TCP, world."""
        i = min(self.row(clock) // self.every, len(self.poses_world_tcp) - 1)
        return self.poses_world_tcp[i]


def joint_course(path: Path, nominal: NominalArm) -> Course:
    """Make a course for the joints' springs."""
    rows = path.sample(cycle_times(path))
    poses = nominal.poses(rows[::COARSE] if len(rows) > 1 else rows)
    if len(rows) > 1:
        poses = np.concatenate([poses, nominal.poses(rows[-1:])])
    return Course(path, None, rows, row_rates(rows), poses, COARSE)


def pose_course(path: PosePath, posture: Array, pose_world_base: Pose) -> Course:
    """Make a course for the TCP's springs."""
    coordinates = path.path.sample(cycle_times(path.path))
    quaternions = np.array(turned(path.origin, coordinates[:, 3:]))
    poses = np.concatenate([coordinates[:, :3], quaternions], axis=1)
    rates = row_rates(coordinates)
    into_base = pose_world_base.rotation.T
    positions = (poses[:, :3] - pose_world_base.position) @ into_base.T
    conjugate = pose_world_base.quaternion * [1.0, -1.0, -1.0, -1.0]
    turns = quaternions @ quaternion_matrix(conjugate).T
    # rotation vectors are in the origin's frame
    to_base = into_base @ Pose(np.zeros(3), path.origin).rotation
    twists = np.concatenate([rates[:, :3] @ into_base.T, rates[:, 3:] @ to_base.T], axis=1)
    rows = np.concatenate([positions, turns[:, 1:], turns[:, :1]], axis=1)
    return Course(path, posture, rows, twists, poses, 1)


def cycle_times(path: Path) -> Array:
    """Return the times of all cycles of a path."""
    count = max(0, int(np.ceil((path.end - path.knots[0]) / CYCLE - 1e-9)))
    return path.knots[0] + CYCLE * np.arange(count + 1.0)


def row_rates(rows: Array) -> Array:
    """Differentiate the rows by central differences; the last row is at rest."""
    if len(rows) < 3:
        return np.zeros_like(rows)
    rates = np.gradient(rows, CYCLE, axis=0)
    rates[-1] = 0.0
    return rates
