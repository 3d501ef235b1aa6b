"""A pose as a function of time."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from palpate.geometry.pose import Array, Pose
from palpate.robots.trajectory.path import Motion, Path


@dataclass(frozen=True, slots=True, eq=False)
class PosePath:
    """A pose as a function of time: position and, relative to `origin`, rotation vector on one
    `Path`."""

    path: Path
    origin: Array
    """(4,) quaternion, wxyz."""

    @property
    def end(self) -> float:
        """Time at which it comes to rest, s."""
        return self.path.end

    def pose(self, t: float) -> Pose:
        """The pose at one time."""
        row = self.path.sample(np.array([t]))
        return Pose(row[0, :3], turned(self.origin, row[:, 3:])[0])

    def motion(self, t: float) -> Motion:
        """Position and rotation vector *from the present orientation*: (6,) and their rates."""
        now = self.path.at(t)
        turning = np.zeros(3)
        if np.any(now.v[3:]):
            step = 1e-4
            ahead, here = self.pose(t + step).quaternion, self.pose(t).quaternion
            mujoco.mju_subQuat(turning, ahead, here)
            turning /= step
        zero = np.zeros(3)
        return Motion(
            np.concatenate([now.p[:3], zero]),
            np.concatenate([now.v[:3], turning]),
            np.concatenate([now.a[:3], zero]),
        )


def quaternion_matrix(quaternion: Array) -> Array:
    """Return the matrix (4, 4) of left multiplication by a quaternion (4,), wxyz."""
    w, x, y, z = quaternion
    return np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])


def rotation_vector(start: Array, goal: Array) -> Array:
    """(3,) rad, in the frame of `start`, of the shortest turn from one quaternion to another."""
    out = np.empty(3)
    mujoco.mju_subQuat(out, goal, start)
    return out


def turned(origin: Array, rotation_vectors: Array) -> Array:
    """`origin` turned by each rotation vector (m, 3) in its own frame, (m, 4)."""
    if not rotation_vectors.any():
        return np.broadcast_to(origin, (len(rotation_vectors), 4))
    angle = np.sqrt((rotation_vectors * rotation_vectors).sum(1))
    half = np.sinc(angle / (2 * np.pi))[:, None] / 2 * rotation_vectors
    w, (x, y, z) = np.cos(angle / 2), half.T
    a, b, c, d = origin
    return np.stack(
        [
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y - b * z + c * w + d * x,
            a * z + b * y - c * x + d * w,
        ],
        axis=1,
    )
