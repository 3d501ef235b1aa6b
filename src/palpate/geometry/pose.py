"""Rigid poses, lines of poses, and inertia tensors. Quaternions are (w, x, y, z), as in MuJoCo."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.errors import InputError

Array = NDArray[np.float64]

SPACING = 0.02
"""m: largest distance between the places of a line at which a plan is judged, less than the width of
the fingers' pads, so that what they sweep at two neighbouring places overlaps."""
ROUNDING = 1e-9
"""m."""
CONJUGATE: Array = np.array([1.0, -1.0, -1.0, -1.0])
"""Factors of a unit quaternion (w, x, y, z) that make its inverse."""


def digits(values: Array) -> bytes:
    """Numbers rounded to a millionth, as a key for caches."""
    # Zero has two signs, and one key.
    return (values.round(6) + 0.0).tobytes()


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
    def turn(cls, rotation_vector: ArrayLike) -> Pose:
        """Turn about the origin by a rotation vector (3,), rad."""
        vector = np.asarray(rotation_vector, dtype=float)
        half = float(np.linalg.norm(vector)) / 2
        return cls.of((0.0, 0.0, 0.0), (np.cos(half), *(np.sinc(half / np.pi) / 2 * vector)))

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
        out.flags.writeable = False  # cached, so shared by all callers
        return out.reshape(3, 3)

    @property
    def vector(self) -> Array:
        """(7,) position then quaternion."""
        return np.concatenate([self.position, self.quaternion])

    @cached_property
    def digits(self) -> bytes:
        """The `vector` to a millionth, a key for caches: a search repeats its poses."""
        return digits(self.vector)

    def __matmul__(self, other: Pose) -> Pose:
        """Composition: `pose_a_b @ pose_b_c` is `pose_a_c`."""
        quaternion = np.empty(4)
        mujoco.mju_mulQuat(quaternion, self.quaternion, other.quaternion)
        quaternion /= math.sqrt(quaternion.dot(quaternion))
        return Pose(self.apply(other.position), quaternion)

    def inverse(self) -> Pose:
        """The pose of the reference frame in this one."""
        back = -self.rotation.T.copy()
        return Pose(back @ self.position, self.quaternion * CONJUGATE)

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


def tensor_of(parts: Sequence[float]) -> Array:
    """(3, 3) inertia tensor from xx yy zz xy xz yz, kg m², MJCF's order."""
    xx, yy, zz, xy, xz, yz = parts
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def components(tensor: Array) -> list[float]:
    """xx yy zz xy xz yz of a (3, 3) inertia tensor."""
    rows, columns = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)
    return tensor[rows, columns].tolist()


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """Poses that differ only in their position on a line segment, of which a run measures the best.

    Attributes:
        pose: pose_world_tcp at 0.
        along: (3,) level unit vector in the world.
        least, most: m along it, the ends of the segment.
        believed: m along it, the position taken until a measurement.
    """

    pose: Pose
    along: Array
    least: float
    most: float
    believed: float

    @classmethod
    def through(cls, pose: Pose, half: Array, point: Array) -> Line:
        """The segment from -`half` to +`half`, (3,) m in the world, about a pose; `believed` is the
        position nearest to `point` (3,) in the world."""
        length = float(np.linalg.norm(half))
        line = cls(pose, half / length, -length, length, 0.0)
        return cls(line.pose, line.along, line.least, line.most, line.nearest(point))

    def at(self, place: float) -> Pose:
        """The pose at `place`, m along.

        Raises:
            InputError: outside the segment.
        """
        if not self.least - ROUNDING <= place <= self.most + ROUNDING:
            raise InputError(
                f"{1e3 * place:.0f} mm along is outside {1e3 * self.least:.0f} to "
                f"{1e3 * self.most:.0f} mm, for which the plan was judged"
            )
        return self.pose.translated(place * self.along)

    def nearest(self, point: Array) -> float:
        """Position on the segment nearest to a point (3,) in the world, m along."""
        place = float((point - self.pose.position) @ self.along)
        return min(max(place, self.least), self.most)

    def places(self) -> list[float]:
        """Positions from end to end, m along, no farther apart than `SPACING`."""
        steps = int(np.ceil((self.most - self.least) / SPACING))
        return np.linspace(self.least, self.most, steps + 1).tolist()
