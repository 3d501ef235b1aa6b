"""Inputs of the fit of a look: corners in the picture, lens, camera, tags, things, estimates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from palpate.geometry.pose import Array, Pose
from palpate.seeing.lens import Lens, Mount
from palpate.seeing.tags import Tag


@dataclass(frozen=True, slots=True, eq=False)
class Thing:
    """A body whose pose, or height, is an unknown of the fit.

    Attributes:
        name: of its body.
        pose_world: where the scene has it.
        support: the surface that it stands on in the scene, if any.
        is_surface: its height alone is open.
    """

    name: str
    pose_world: Pose
    support: str | None = None
    is_surface: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Estimated:
    """Pose of a thing by an estimator.

    Attributes:
        pose_camera: in OpenCV's camera frame.
        covariance: (6, 6) of position, m, and rotation, rad, along the camera's axes.
    """

    pose_camera: Pose
    covariance: Array


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Corners in the picture, and what is known of lens, tags, things and camera.

    Attributes:
        seen: corners (4, 2) of each tag in the picture, pixels.
        tags: that the scene states.
        things: by name; what is not in it stands where the scene has it.
        estimates: of objects, by name.
    """

    lens: Lens
    seen: Mapping[int, Array]
    tags: Mapping[int, Tag]
    things: Mapping[str, Thing]
    mount: Mount | None
    estimates: Mapping[str, Estimated] = field(default_factory=dict[str, Estimated])

    def without(self, odd: Outliers) -> Problem:
        """The problem without some tags and estimates, and with things that stand on nothing known."""
        seen = {number: where for number, where in self.seen.items() if number not in odd.tags}
        loose = {name: replace(self.things[name], support=None) for name in odd.leaning}
        kept = {name: one for name, one in self.estimates.items() if name not in odd.estimates}
        return replace(self, seen=seen, things={**self.things, **loose}, estimates=kept)

    def place(self, tag: Tag, pose: Pose | None) -> Pose:
        """Pose of a tag in the world if its thing has this pose."""
        if pose is None:
            return tag.pose_world
        return pose @ self.things[tag.body].pose_world.inverse() @ tag.pose_world

    def pixels(self, camera: Pose, points: Array, zoom: float = 1.0) -> Array:
        """(n, 2) pixels of points (n, 3) in the world; what is behind the camera is far away."""
        local = (points - camera.position) @ camera.rotation
        local[:, 2] = np.maximum(local[:, 2], 1e-3)
        return self.lens.project(local, zoom)


@dataclass(frozen=True, slots=True)
class Outliers:
    """Outliers: tags, things that do not stand as the scene has them, and things whose estimate
    their tags contradict."""

    tags: tuple[int, ...] = ()
    leaning: tuple[str, ...] = ()
    estimates: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.tags or self.leaning or self.estimates)

    def __add__(self, other: Outliers) -> Outliers:
        return Outliers(
            self.tags + other.tags,
            self.leaning + other.leaning,
            self.estimates + other.estimates,
        )
