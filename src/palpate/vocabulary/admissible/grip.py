"""Contact of the pads with an object between them, and its width there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.geometry.pose import Array, Pose
from palpate.vocabulary.admissible.solids import SIDES, Solids
from palpate.vocabulary.admissible.sweep.frames import Cluster, Frames, Shape

BITE = 0.004
"""m that the pads must have of an object, in height and along it: less is an edge that slips out."""
MEETS = 0.0002
"""m: pads this near to an object have met it."""
APPROACHES = 40
"""Steps in which a pad closes in on an object."""


@dataclass(frozen=True, slots=True)
class Grip:
    """Contact of the pads with an object.

    Attributes:
        width: m between the pads once they are closed on it.
        aside: m that its middle there is beside the tool's axis, along the tool's y.
    """

    width: float
    aside: float


def grip(shapes: Solids, name: str, pose_tcp_object: Pose) -> Grip | None:
    """Contact of the pads with an object at a pose in the tool frame; None where it is not between
    them: the pads would close beside it, above it, or on hardly more than an edge."""
    key = ("grip", name, pose_tcp_object.digits)
    return shapes.remembered(key, lambda: _grip(shapes, name, pose_tcp_object))


def _grip(shapes: Solids, name: str, pose_tcp_object: Pose) -> Grip | None:
    body = shapes.scene.body(name)
    middle = pose_tcp_object.apply(body.centre)
    if np.linalg.norm(middle) > np.linalg.norm(body.size) / 2 + shapes.scene.arm.hand.opening:
        return None
    for shift in ((0.0, 0.0, BITE), (BITE, 0.0, 0.0), (-BITE, 0.0, 0.0)):
        if _closed(shapes, name, pose_tcp_object.translated(shift)) is None:
            return None
    return _closed(shapes, name, pose_tcp_object)


def _closed(shapes: Solids, name: str, pose_tcp_object: Pose) -> Grip | None:
    """Contact points of the pads as each closes from its open position."""
    travels: dict[str, float] = {}
    for side in SIDES:
        travel = _until_met(shapes, side, shapes.objects[name], pose_tcp_object)
        if travel is None:
            return None
        travels[side] = travel
    left, right = travels.values()
    width = shapes.scene.arm.hand.opening - left - right
    return Grip(width, (right - left) / 2) if width > 0 else None


def _until_met(
    shapes: Solids, side: str, parts: tuple[Shape, ...], pose_tcp_object: Pose
) -> float | None:
    """m that a finger's pads travel inwards from open until one meets a part of an object; None
    where they meet none."""
    pads, opening = shapes.pads(side), shapes.scene.arm.hand.opening
    there = Cluster.of(parts).at(pose_tcp_object.position[None], pose_tcp_object.rotation[None])
    travel = 0.0
    for _ in range(APPROACHES):
        here = np.array([[0.0, SIDES[side] * (opening / 2 - travel), 0.0]])
        apart = _apart(shapes, pads, parts, Frames.joined([_at(pads, here), there]))
        if apart < MEETS:
            return travel
        travel += apart
        if travel >= opening:
            return None
    return travel


def _at(pads: tuple[Shape, ...], position: Array) -> Frames:
    return Cluster.of(pads).at(position, np.eye(3)[None])


def _apart(shapes: Solids, pads: tuple[Shape, ...], parts: tuple[Shape, ...], at: Frames) -> float:
    """m between the nearest of the pads and of the parts."""
    found = [
        shapes.distance(pad.geom, part.geom, at, i, len(pads) + j)
        for i, pad in enumerate(pads)
        for j, part in enumerate(parts)
    ]
    return min(found, default=np.inf)
