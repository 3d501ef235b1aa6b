"""Detections of a model in a picture, their shapes in the world, and the planes that support them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from palpate.errors import InputError

Shape = Literal["box", "cylinder", "sphere", "plane"]


@dataclass(frozen=True, slots=True)
class SceneObject:
    """An object or a support plane that a model detected in a picture.

    Attributes:
        name: as in its pose name.
        shape: primitive shape; `plane` is a support.
        bbox: (left, top, right, bottom) in the image, as fractions of its width and height.
        height: of a plane, world z of its top as the model estimates, m; or None.
        outline: corner points (x, y) of its silhouette, as fractions; None if only its box is known.
    """

    name: str
    shape: Shape
    bbox: tuple[float, float, float, float]
    height: float | None = None
    outline: tuple[tuple[float, float], ...] | None = None


@dataclass(frozen=True, slots=True)
class Fitted:
    """A shape in the world: `x`, `y` of its middle, `width`, `depth` and `height`, m; `yaw`, rad."""

    thing: SceneObject
    x: float
    y: float
    width: float
    depth: float
    height: float
    yaw: float = 0.0


RIM = 0.03
"""m: least margin of a plane around the objects on it."""

FOOT = 0.20
"""m around the arm's foot: its base reaches as far, and its hand not so near."""


def planes_and_things(
    objects: Sequence[SceneObject],
) -> tuple[list[SceneObject], list[SceneObject]]:
    """Sort detections into planes and objects.

    Raises:
        InputError: no planes, or a name twice.
    """
    for name, following in pairwise(sorted(thing.name for thing in objects)):
        if name == following:
            raise InputError(f"scene: '{name}' is listed twice; give every thing a name of its own")
    planes = [thing for thing in objects if thing.shape == "plane"]
    if not planes:
        raise InputError(
            "scene: nothing is listed that the things stand on; list it with the shape 'plane'"
        )
    return planes, [thing for thing in objects if thing.shape != "plane"]


def is_mount(shape: Fitted) -> bool:
    """True if a shape is at the arm's foot: its base, its pedestal, part of the arm itself."""
    return float(np.hypot(shape.x, shape.y)) < FOOT


def support_of(thing: SceneObject, planes: Sequence[SceneObject]) -> SceneObject:
    """The smallest plane whose box contains the foot of the object's box, else the largest."""
    x, y = (thing.bbox[0] + thing.bbox[2]) / 2, thing.bbox[3]

    def area(plane: SceneObject) -> float:
        left, top, right, bottom = plane.bbox
        return (right - left) * (bottom - top)

    below: list[SceneObject] = []
    for plane in planes:
        left, top, right, bottom = plane.bbox
        if left <= x <= right and top <= y <= bottom:
            below.append(plane)
    return min(below, key=area) if below else max(planes, key=area)


def widened(slab: Fitted, standing: Sequence[Fitted]) -> Fitted:
    """The slab, enlarged so that it reaches `RIM` beyond the objects on it."""
    left, right = slab.x - slab.width / 2, slab.x + slab.width / 2
    near, far = slab.y - slab.depth / 2, slab.y + slab.depth / 2
    for shape in standing:
        across, along = shape.width / 2 + RIM, shape.depth / 2 + RIM
        left, right = min(left, shape.x - across), max(right, shape.x + across)
        near, far = min(near, shape.y - along), max(far, shape.y + along)
    return Fitted(slab.thing, (left + right) / 2, (near + far) / 2, right - left, far - near, 0.0)
