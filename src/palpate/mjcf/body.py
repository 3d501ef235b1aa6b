"""An object or a surface of the scene."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from palpate.geometry.pose import Array, Pose


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """An object (free joint) or a surface (static, carries things) of the scene.

    Attributes:
        name: as in the MJCF.
        role: `object` or `surface`.
        words: lower-case words a request may use for it: parts of its name, its colour, its shape.
        pose_world: believed pose of the body frame (of a geom that stands in the worldbody: its
            frame); unknown numbers hold a prior.
        centre, size: (3,) box around its geoms in its own frame: centre and full extents, m. Of a
            surface: the box around the geom whose top carries.
        known: quantity id to value, for what the MJCF states.
        missing: quantity ids that the MJCF leaves out or writes `?`.
        assumed: quantity ids MuJoCo would infer (com, inertia from uniform density).
    """

    name: str
    role: Literal["object", "surface"]
    words: frozenset[str]
    pose_world: Pose
    centre: Array
    size: Array
    known: Mapping[str, tuple[float, ...]]
    missing: frozenset[str]
    assumed: frozenset[str] = frozenset()

    reach: float = field(init=False)
    """No point of its box is farther than this from its frame's origin, m."""

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "reach", float(np.linalg.norm(self.centre) + np.linalg.norm(self.size) / 2)
        )

    def top_z(self, pose_world: Pose | None = None) -> float:
        """World z of the top of its box, at its believed pose or at `pose_world`, m."""
        middle, half = self._vertical(pose_world or self.pose_world)
        return middle + half

    def bottom_z(self, pose_world: Pose | None = None) -> float:
        """World z of the bottom of its box, m."""
        middle, half = self._vertical(pose_world or self.pose_world)
        return middle - half

    def covers(self, x: float, y: float, pose_world: Pose | None = None) -> bool:
        """Whether the point is above its box's footprint."""
        pose = pose_world or self.pose_world
        at_x, at_y, _ = pose.position.tolist()
        if not self.is_near(x - at_x, y - at_y):
            return False
        down = pose.rotation[2]
        start = pose.local((x, y, pose.position[2])) - self.centre
        along = np.where(np.abs(down) > 1e-9, down, 1e-9)
        near, far = (-start - self.size / 2) / along, (-start + self.size / 2) / along
        return bool(np.minimum(near, far).max() <= np.maximum(near, far).min() + 1e-9)

    def is_near(self, x: float, y: float, margin: float = 0.0) -> bool:
        """Whether a point `x`, `y` m beside its frame's origin may be within `margin` m of its box:
        a quick bound."""
        return math.hypot(x, y) <= self.reach + margin

    def _vertical(self, pose: Pose) -> tuple[float, float]:
        up = pose.rotation[2]
        return float(pose.position[2] + up @ self.centre), float(np.abs(up) @ self.size / 2)
