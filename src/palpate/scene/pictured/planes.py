"""Support planes in a picture."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from palpate.errors import InputError
from palpate.scene.pictured.objects import Fitted, SceneObject

RIM = 0.03
"""m: how far a plane reaches, at least, beyond what stands on it."""

FOOT = 0.20
"""m around the arm's foot: the base of an arm of this size reaches as far, and its hand not so near."""


def planes_and_things(
    objects: Sequence[SceneObject],
) -> tuple[list[SceneObject], list[SceneObject]]:
    """Planes and things.

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
    """True if it stands where the arm does: its foot, its pedestal, part of the arm itself."""
    return float(np.hypot(shape.x, shape.y)) < FOOT


def support_of(thing: SceneObject, planes: Sequence[SceneObject]) -> SceneObject:
    """The smallest plane in whose box the foot of the thing's box is, else the largest."""
    left, _, right, bottom = thing.bbox
    below = [plane for plane in planes if _covers(plane, (left + right) / 2, bottom)]
    if below:
        return min(below, key=_area)
    return max(planes, key=_area)


def _covers(plane: SceneObject, x: float, y: float) -> bool:
    """True if a point of the image is in the plane's box."""
    left, top, right, bottom = plane.bbox
    return left <= x <= right and top <= y <= bottom


def _area(thing: SceneObject) -> float:
    left, top, right, bottom = thing.bbox
    return (right - left) * (bottom - top)


def widened(slab: Fitted, standing: Sequence[Fitted]) -> Fitted:
    """The slab, large enough for what stands on it."""
    left, right = _reach(slab.x, slab.width / 2)
    near, far = _reach(slab.y, slab.depth / 2)
    for shape in standing:
        west, east = _reach(shape.x, shape.width / 2 + RIM)
        south, north = _reach(shape.y, shape.depth / 2 + RIM)
        left, right = min(left, west), max(right, east)
        near, far = min(near, south), max(far, north)
    return Fitted(slab.thing, (left + right) / 2, (near + far) / 2, right - left, far - near, 0.0)


def _reach(middle: float, half: float) -> tuple[float, float]:
    """From where to where."""
    return middle - half, middle + half
