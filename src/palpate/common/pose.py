"""Poses, their composition over time, and joint motion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.common.errors import InputError

Array = NDArray[np.float64]

# m: largest distance between the stations of a line at which a plan is checked. It is less than the
# width of the fingers' pads, so that the swept volumes of neighbouring stations overlap.
SPACING = 0.02
ROUNDING = 1e-9  # m: tolerance of positions on a line
# Factors of a unit quaternion (w, x, y, z) that make its inverse.
CONJUGATE: Array = np.array([1.0, -1.0, -1.0, -1.0])


def digits(values: Array) -> bytes:
    """Round numbers to a millionth, as a key for caches."""
    # Adding zero removes the sign of zero, so that both zeros have one key.
    return (values.round(6) + 0.0).tobytes()


@dataclass(frozen=True, eq=False)
class Pose:
    """Pose of a frame in another frame: `position` (3,) in m and unit `quaternion` (4,), wxyz.

    Variable names state both frames: `pose_world_tcp` is the pose of `tcp` in `world`.
    """

    position: Array
    quaternion: Array

    @classmethod
    def of(cls, position: ArrayLike, quaternion: ArrayLike = (1.0, 0.0, 0.0, 0.0)) -> Pose:
        """Make a pose from any array-likes; the quaternion is normalised."""
        q = np.array(quaternion, dtype=float)
        norm = math.sqrt(q.dot(q))
        if not math.isfinite(norm) or norm < 1e-9:
            raise ValueError(f"not a rotation quaternion: {quaternion!r}")
        return cls(np.array(position, dtype=float), q / norm)

    @classmethod
    def turn(cls, rotation_vector: ArrayLike) -> Pose:
        """Return the rotation about the origin by a rotation vector (3,), rad."""
        vector = np.asarray(rotation_vector, dtype=float)
        # sinc keeps the quaternion of a small rotation exact.
        half = float(np.linalg.norm(vector)) / 2
        return cls.of((0.0, 0.0, 0.0), (np.cos(half), *(np.sinc(half / np.pi) / 2 * vector)))

    @classmethod
    def top_down(cls, position: ArrayLike, yaw: float) -> Pose:
        """Return the pose of a tool that points down (its z along world -z), with the closing direction (its
        y) turned by `yaw` rad.

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
        """Position, then quaternion (7,)."""
        return np.concatenate([self.position, self.quaternion])

    @cached_property
    def digits(self) -> bytes:
        """`vector` rounded to a millionth, a key for caches: a search repeats its poses."""
        return digits(self.vector)

    def __matmul__(self, other: Pose) -> Pose:
        """Compose poses: `pose_a_b @ pose_b_c` is `pose_a_c`."""
        quaternion = np.empty(4)
        mujoco.mju_mulQuat(quaternion, self.quaternion, other.quaternion)
        quaternion /= math.sqrt(quaternion.dot(quaternion))
        return Pose(self.apply(other.position), quaternion)

    def inverse(self) -> Pose:
        """Return the pose of the reference frame in this frame."""
        back = -self.rotation.T.copy()
        return Pose(back @ self.position, self.quaternion * CONJUGATE)

    def apply(self, point: ArrayLike) -> Array:
        """Convert a point (3,) from this frame to the reference frame."""
        return self.position + self.rotation @ np.asarray(point, dtype=float)

    def local(self, point: ArrayLike) -> Array:
        """Convert a point (3,) from the reference frame to this frame."""
        return (np.asarray(point, dtype=float) - self.position) @ self.rotation

    def translate(self, offset: ArrayLike) -> Pose:
        """Shift the pose by `offset` (3,), along the reference frame's axes."""
        return Pose(self.position + np.asarray(offset, dtype=float), self.quaternion)

    def angle_to(self, other: Pose) -> float:
        """Compute the rotation angle between the two orientations, rad in [0, pi]."""
        # q and -q are one orientation: angle = 2 arccos |q1 · q2|.
        dot = abs(float(self.quaternion @ other.quaternion))
        return 2.0 * float(np.arccos(min(1.0, dot)))

    def distance_to(self, other: Pose) -> float:
        """Compute the distance between the two origins, m."""
        offset = self.position - other.position
        return math.sqrt(offset.dot(offset))


def rotations(quaternions: Array) -> Array:
    """Compute the rotation matrices (n, 3, 3) of unit quaternions (n, 4), wxyz."""
    # Standard formula of the rotation matrix, row by row.
    w, x, y, z = quaternions.T
    rows = [
        [1.0 - 2.0 * (y**2 + z**2), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x**2 + z**2), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x**2 + y**2)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def tensor_of(parts: Sequence[float]) -> Array:
    """Return the inertia tensor (3, 3) of xx yy zz xy xz yz, kg m², in MJCF's order."""
    xx, yy, zz, xy, xz, yz = parts
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def components(tensor: Array) -> list[float]:
    """Return xx yy zz xy xz yz of an inertia tensor (3, 3)."""
    rows, columns = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)
    return tensor[rows, columns].tolist()


@dataclass(frozen=True, slots=True, eq=False)
class PoseLine:
    """Poses that differ only in their position on a line segment; a run finds the best of them."""

    pose: Pose  # pose_world_tcp at 0
    along: Array  # (3,) level unit vector in the world
    # least, most: m along it, the ends of the segment.
    least: float
    most: float
    believed: float  # m along it, the assumed position before a measurement

    @classmethod
    def spanning(cls, pose: Pose, half: Array, point: Array) -> PoseLine:
        """Make the segment from -`half` to +`half`, (3,) m in the world, about a pose.

        `believed` is the position nearest to `point` (3,) in the world.
        """
        # A unit direction, and the ends at plus and minus its length.
        length = float(np.linalg.norm(half))
        line = cls(pose, half / length, -length, length, 0.0)
        return cls(line.pose, line.along, line.least, line.most, line.nearest(point))

    def at(self, place: float) -> Pose:
        """Return the pose at `place`, m along. Raises InputError: outside the segment."""
        if not self.least - ROUNDING <= place <= self.most + ROUNDING:
            raise InputError(
                f"{1e3 * place:.0f} mm along is outside {1e3 * self.least:.0f} to "
                f"{1e3 * self.most:.0f} mm, for which the plan was judged"
            )
        return self.pose.translate(place * self.along)

    def nearest(self, point: Array) -> float:
        """Compute the position on the segment nearest to a point (3,) in the world, m along."""
        place = float((point - self.pose.position) @ self.along)
        return min(max(place, self.least), self.most)

    def places(self) -> list[float]:
        """Return positions from end to end, m along, no farther apart than `SPACING`."""
        steps = int(np.ceil((self.most - self.least) / SPACING))
        return np.linspace(self.least, self.most, steps + 1).tolist()


# Poses of several shapes at several moments.


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """Poses of k shapes at n moments: positions (n, k, 3) and rotations (n, k, 3, 3)."""

    positions: Array
    rotations: Array

    @classmethod
    def concatenate(cls, parts: Sequence[Frames]) -> Frames:
        """Concatenate shapes of several carriers at the same moments."""
        return cls(
            np.concatenate([part.positions for part in parts], axis=1),
            np.concatenate([part.rotations for part in parts], axis=1),
        )

    @classmethod
    def concatenate_moments(cls, parts: Sequence[Frames]) -> Frames:
        """Concatenate moments of the same shapes."""
        return cls(
            np.concatenate([part.positions for part in parts]),
            np.concatenate([part.rotations for part in parts]),
        )

    def at(self, moment: int) -> Frames:
        """Select one moment."""
        return self.part(slice(moment, moment + 1))

    def part(self, moments: slice) -> Frames:
        """Select some moments."""
        return Frames(self.positions[moments], self.rotations[moments])


# Slide or hinge joint: the motion that it guides, in the world.


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """A slide or hinge joint in the world."""

    kind: Literal["slide", "hinge"]
    axis: Array  # (3,) unit, world; a hinge turns counterclockwise about it
    anchor: Array  # (3,) m, a point on the axis of a hinge
    # low, high: limits, m or rad; infinite where there are none.
    low: float
    high: float
    position: float  # position in the scene, m or rad
    spring: float  # position at which its spring is relaxed, m or rad
    # True for its lower, and its upper limit, if the file leaves it open: it is a belief then.
    open: tuple[bool, bool] = (False, False)

    @property
    def is_slide(self) -> bool:
        """True for a slide, False for a hinge."""
        return self.kind == "slide"

    def room(self, sign: float) -> float:
        """Compute the travel, m or rad, from the present position to the upper limit (1) or the lower (-1)."""
        return self.high - self.position if sign > 0.0 else self.position - self.low

    def unit(self, per: str = "") -> str:
        """Return the unit of its position, `m` or `rad`; with `per`, of a force or moment per unit of it,
        `N·s/m` or `N·m·s/rad`.
        """
        own = "m" if self.is_slide else "rad"
        return f"{per if self.is_slide else per.replace('N', 'N·m')}/{own}" if per else own

    def motion(self, travel: float) -> Pose:
        """Compute the rigid motion (world) of all guided bodies, by `travel`, m or rad."""
        if self.is_slide:
            return Pose.of(travel * self.axis)
        # A hinge turns about its axis through the anchor.
        half = travel / 2.0
        turn = Pose.of((0.0, 0.0, 0.0), (np.cos(half), *(np.sin(half) * self.axis)))
        return turn.translate(self.anchor - turn.apply(self.anchor))

    def travels(self, start: Pose, positions: Array) -> Array:
        """Compute the travel (n,), m or rad, from the position of `start` to points (n, 3), world."""
        if self.is_slide:
            return (positions - start.position) @ self.axis
        # Angle between the radii of start and points, about the axis.
        first, across = self._radius(start.position[None])[0], self._radius(positions)
        sines: Array = np.cross(first, across) @ self.axis
        return np.arctan2(sines, across @ first)

    def lever(self, point: Array) -> float:
        """Compute the travel, m, of a point (3,), world, per unit of the joint's travel: 1 for a slide, else
        the distance from the axis.
        """
        return 1.0 if self.is_slide else float(np.linalg.norm(self._radius(point[None])))

    def direction(self, point: Array) -> Array:
        """Compute the unit direction (3,) in which a point (3,), world, moves as the joint's position grows."""
        if self.is_slide:
            return self.axis
        # Velocity of a point on a hinge: axis × radius.
        tangent = np.cross(self.axis, point - self.anchor)
        return tangent / max(float(np.linalg.norm(tangent)), 1e-9)

    def along(self, points: Array) -> Array:
        """Compute rows (n, 6) whose product with a wrench about each of the points (n, 3) is the force or
        moment along the joint.

        Wrenches are in world axes.
        """
        forces = np.tile(self.axis, (len(points), 1))
        if self.is_slide:
            return np.concatenate([forces, np.zeros_like(forces)], axis=1)
        # The moment about the axis, a · (r × f + n) = (a × r) · f + a · n.
        levers = np.cross(self.axis, points - self.anchor)
        return np.concatenate([levers, forces], axis=1)

    def _radius(self, points: Array) -> Array:
        """Compute the perpendicular vectors (n, 3), m, from the axis to points (n, 3)."""
        # Subtract the component along the axis.
        offset = points - self.anchor
        return offset - np.outer(offset @ self.axis, self.axis)
