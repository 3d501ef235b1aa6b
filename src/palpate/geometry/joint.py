"""A slide or hinge joint: how what it guides moves in the world."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from palpate.geometry.pose import Array, Pose


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """A slide or hinge joint in the world.

    Attributes:
        axis: (3,) unit, world; a hinge turns counterclockwise about it.
        anchor: (3,) m, a point on the axis of a hinge.
        low, high: limits, m or rad; infinite where there are none.
        position: where it is in the scene, m or rad.
        spring: position at which its spring is relaxed, m or rad.
        open: whether the file leaves its lower, and its upper limit open: then they are beliefs.
    """

    kind: Literal["slide", "hinge"]
    axis: Array
    anchor: Array
    low: float
    high: float
    position: float
    spring: float
    open: tuple[bool, bool] = (False, False)

    @property
    def is_slide(self) -> bool:
        """Slide, not hinge."""
        return self.kind == "slide"

    def room(self, sign: float) -> float:
        """Travel, m or rad, from where it is to its upper limit (1) or its lower (-1)."""
        return self.high - self.position if sign > 0.0 else self.position - self.low

    def unit(self, per: str = "") -> str:
        """Unit of its position, `m` or `rad`; of a force or moment `per` that, `N·s/m` or `N·m·s/rad`."""
        own = "m" if self.is_slide else "rad"
        return f"{per if self.is_slide else per.replace('N', 'N·m')}/{own}" if per else own

    def motion(self, travel: float) -> Pose:
        """Rigid motion (world) of all that it guides, by `travel`, m or rad."""
        if self.is_slide:
            return Pose.of(travel * self.axis)
        half = travel / 2.0
        turn = Pose.of((0.0, 0.0, 0.0), (np.cos(half), *(np.sin(half) * self.axis)))
        return turn.translated(self.anchor - turn.apply(self.anchor))

    def travels(self, start: Pose, positions: Array) -> Array:
        """(n,) m or rad, by which points (n, 3), world, are farther along it than the place of `start`."""
        if self.is_slide:
            return (positions - start.position) @ self.axis
        first, across = self._radius(start.position[None])[0], self._radius(positions)
        sines: Array = np.cross(first, across) @ self.axis
        return np.arctan2(sines, across @ first)

    def lever(self, point: Array) -> float:
        """Travel, m, of a point (3,), world, per unit of the joint's: 1 of a slide, else its distance from
        the axis."""
        return 1.0 if self.is_slide else float(np.linalg.norm(self._radius(point[None])))

    def direction(self, point: Array) -> Array:
        """(3,) unit, in which a point (3,), world, moves as the joint's position grows."""
        if self.is_slide:
            return self.axis
        way = np.cross(self.axis, point - self.anchor)
        return way / max(float(np.linalg.norm(way)), 1e-9)

    def along(self, points: Array) -> Array:
        """(n, 6) whose product with a wrench (world axes) about each of the points (n, 3) is the force or
        moment along the joint."""
        forces = np.tile(self.axis, (len(points), 1))
        if self.is_slide:
            return np.concatenate([forces, np.zeros_like(forces)], axis=1)
        # The moment about the axis, a · (r × f + n) = (a × r) · f + a · n.
        levers = np.cross(self.axis, points - self.anchor)
        return np.concatenate([levers, forces], axis=1)

    def _radius(self, points: Array) -> Array:
        """(n, 3) m, from the axis to points (n, 3)."""
        apart = points - self.anchor
        return apart - np.outer(apart @ self.axis, self.axis)
