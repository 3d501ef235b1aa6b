"""A commanded motion as a table: where the equilibrium is in each cycle after it has begun.

A course has a clock of its own, which begins when the arm first follows it and never runs faster than
the robot's: whatever holds the computer up, the reference goes on from where it was.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.geometry.pose import Array, Pose
from palpate.robots.franky.library import franky
from palpate.robots.nominal import NominalArm
from palpate.robots.trajectory.path import Path
from palpate.robots.trajectory.posed import PosePath, turned

CYCLE = 0.001
"""s of a control cycle."""
COARSE = 5
"""Cycles between two poses of a joint motion that are told."""


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """A motion's references in the base's frame.

    Attributes:
        path: what they are of; its time begins at 0.
        posture: (7,) rad, where the null space goes, of a Cartesian motion.
        rows: (m, 7) joint positions, or positions and quaternions xyzw.
        rates: (m, 7) rad/s, or (m, 6) twists.
        poses_world_tcp: (k, 7) commanded TCP poses, one each `every` rows.
    """

    path: Path | PosePath
    posture: Array | None
    rows: Array
    rates: Array
    poses_world_tcp: Array
    every: int

    @property
    def last(self) -> int:
        """Row in which it has come to rest."""
        return len(self.rows) - 1

    def reference(self, clock: float) -> Any:
        """franky's reference `clock` s after the beginning."""
        i = self.row(clock)
        if self.posture is None:
            return franky().JointReference(q=self.rows[i], dq=self.rates[i])
        module, row, rate = franky(), self.rows[i], self.rates[i]
        twist = module.Twist(rate[:3], rate[3:])
        return module.CartesianReference(module.Affine(row[:3], row[3:]), twist)

    def row(self, clock: float) -> int:
        """The row that is due."""
        return min(round(clock / CYCLE), self.last)

    def target(self, clock: float) -> Array:
        """(7,) commanded pose of the TCP, world."""
        return self.poses_world_tcp[
            min(self.row(clock) // self.every, len(self.poses_world_tcp) - 1)
        ]


def joint_course(path: Path, nominal: NominalArm) -> Course:
    """Of the joints' springs."""
    rows = path.sample(_times(path))
    poses = nominal.poses(rows[::COARSE] if len(rows) > 1 else rows)
    if len(rows) > 1:
        poses = np.concatenate([poses, nominal.poses(rows[-1:])])
    return Course(path, None, rows, _rates(rows), poses, COARSE)


def pose_course(path: PosePath, posture: Array, pose_world_base: Pose) -> Course:
    """Of the TCP's springs."""
    coordinates = path.path.sample(_times(path.path))
    quaternions = np.array(turned(path.origin, coordinates[:, 3:]))
    poses = np.concatenate([coordinates[:, :3], quaternions], axis=1)
    rates = _rates(coordinates)
    into_base = pose_world_base.rotation.T
    positions = (poses[:, :3] - pose_world_base.position) @ into_base.T
    turns = _turned_back(pose_world_base.quaternion, quaternions)
    # rotation vectors are in the origin's frame
    to_base = into_base @ Pose(np.zeros(3), path.origin).rotation
    twists = np.concatenate([rates[:, :3] @ into_base.T, rates[:, 3:] @ to_base.T], axis=1)
    rows = np.concatenate([positions, turns[:, 1:], turns[:, :1]], axis=1)
    return Course(path, posture, rows, twists, poses, 1)


def _times(path: Path) -> Array:
    count = max(0, int(np.ceil((path.end - path.knots[0]) / CYCLE - 1e-9)))
    return path.knots[0] + CYCLE * np.arange(count + 1.0)


def _rates(rows: Array) -> Array:
    """Central differences; at rest at the end."""
    if len(rows) < 3:
        return np.zeros_like(rows)
    rates = np.gradient(rows, CYCLE, axis=0)
    rates[-1] = 0.0
    return rates


def _turned_back(frame: Array, quaternions: Array) -> Array:
    """Quaternions (m, 4), wxyz, in the axes of `frame`."""
    w, x, y, z = frame * [1.0, -1.0, -1.0, -1.0]
    left = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])
    return quaternions @ left.T
