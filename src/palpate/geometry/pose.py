"""Rigid poses. Quaternions are (w, x, y, z), as in MuJoCo."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def digits(values: Array) -> bytes:
    """Numbers to a millionth, for a key."""
    return values.round(6).tobytes()


@dataclass(frozen=True, eq=False)
class Pose:
    """A frame's pose in another: `position` (3,) in m and `quaternion` (4,) wxyz, of unit length.

    Names say which: `pose_world_tcp` is the pose of `tcp` in `world`.
    """

    position: Array
    quaternion: Array

    @classmethod
    def of(cls, position: ArrayLike, quaternion: ArrayLike = (1.0, 0.0, 0.0, 0.0)) -> Pose:
        """A pose from any array-likes; the quaternion is normalised."""
        q = np.array(quaternion, dtype=float)
        norm = math.sqrt(q.dot(q))
        if not math.isfinite(norm) or norm < 1e-9:
            raise ValueError(f"not a rotation quaternion: {quaternion!r}")
        return cls(np.array(position, dtype=float), q / norm)

    @classmethod
    def top_down(cls, position: ArrayLike, yaw: float) -> Pose:
        """The tool pointing down (its z along world -z), closing direction (its y) turned by `yaw`
        rad.

        At yaw 0 the tool's x is world x and its y is world -y.
        """
        half = yaw / 2
        return cls.of(position, (0.0, np.cos(half), np.sin(half), 0.0))

    @cached_property
    def rotation(self) -> Array:
        """Rotation matrix (3, 3)."""
        out = np.empty(9)
        mujoco.mju_quat2Mat(out, self.quaternion)
        out.flags.writeable = False  # shared by all who ask
        return out.reshape(3, 3)

    @property
    def vector(self) -> Array:
        """(7,) position then quaternion."""
        return np.concatenate([self.position, self.quaternion])

    @cached_property
    def digits(self) -> bytes:
        """The `vector` to a millionth, for a key: a search asks for the same poses again and again."""
        return digits(self.vector)

    def __matmul__(self, other: Pose) -> Pose:
        """Composition: `pose_a_b @ pose_b_c` is `pose_a_c`."""
        quaternion = np.empty(4)
        mujoco.mju_mulQuat(quaternion, self.quaternion, other.quaternion)
        return Pose.of(self.apply(other.position), quaternion)

    def inverse(self) -> Pose:
        """The pose of the reference frame in this one."""
        conjugate = self.quaternion * np.array([1.0, -1.0, -1.0, -1.0])
        return Pose(-Pose(np.zeros(3), conjugate).rotation @ self.position, conjugate)

    def apply(self, point: ArrayLike) -> Array:
        """A point (3,) given in this frame, in the reference frame."""
        return self.position + self.rotation @ np.asarray(point, dtype=float)

    def local(self, point: ArrayLike) -> Array:
        """A point (3,) given in the reference frame, in this one."""
        return (np.asarray(point, dtype=float) - self.position) @ self.rotation

    def translated(self, offset: ArrayLike) -> Pose:
        """Shifted by `offset` (3,), given along the reference frame's axes."""
        return Pose(self.position + np.asarray(offset, dtype=float), self.quaternion)

    def angle_to(self, other: Pose) -> float:
        """Rotation angle between the two orientations, rad in [0, pi]."""
        dot = abs(float(self.quaternion @ other.quaternion))
        return 2.0 * float(np.arccos(min(1.0, dot)))

    def distance_to(self, other: Pose) -> float:
        """Distance between the two origins, m."""
        apart = self.position - other.position
        return math.sqrt(apart.dot(apart))


def rotations(quaternions: Array) -> Array:
    """(n, 3, 3) rotation matrices of unit quaternions (n, 4), wxyz."""
    w, x, y, z = quaternions.T
    rows = [
        [1.0 - 2.0 * (y**2 + z**2), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x**2 + z**2), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x**2 + y**2)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)
