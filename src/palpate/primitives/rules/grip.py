"""Grip: contact of the pads with an object between them, and its width there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.common.pose import Frames, Pose
from palpate.primitives.rules.solids import SIDES, Solids

BITE = 0.004  # m of an object, in height and length, that the pads must cover; an edge slips out
MEETS = 0.0002  # m between a pad and an object, up to which they are in contact
APPROACHES = 40  # Largest number of steps in which a pad closes in on an object


@dataclass(frozen=True, slots=True)
class Grip:
    """Contact of the pads with an object."""

    width: float  # m between the closed pads
    aside: float  # m, offset of the object's middle from the tool's axis, along the tool's y


def grip(shapes: Solids, name: str, pose_tcp_object: Pose) -> Grip | None:
    """Contact of the pads with an object in the tool frame; None if they cover less than `BITE` of it."""
    like = shapes.alike[name]

    def compute() -> Grip | None:
        body = shapes.scene.body(like)
        # Cheap test first: the fingers cannot meet an object outside its bounding sphere.
        middle = pose_tcp_object.apply(body.centre)
        if np.linalg.norm(middle) > np.linalg.norm(body.size) / 2 + shapes.scene.arm.hand.opening:
            return None
        # On an edge alone, the pads miss the object once it is shifted by the bite.
        for shift in ((0.0, 0.0, BITE), (BITE, 0.0, 0.0), (-BITE, 0.0, 0.0)):
            if _close_pads(shapes, like, pose_tcp_object.translate(shift)) is None:
                return None
        return _close_pads(shapes, like, pose_tcp_object)

    return shapes.get_or_compute(("grip", like, pose_tcp_object.digits), compute)


def _close_pads(shapes: Solids, name: str, pose_tcp_object: Pose) -> Grip | None:
    """Contact of the pads as each closes from its open position."""
    travels: list[float] = []
    for side in SIDES:
        travel = _travel(shapes, side, name, pose_tcp_object)
        if travel is None:
            return None
        travels.append(travel)
    left, right = travels
    width = shapes.scene.arm.hand.opening - left - right
    return Grip(width, (right - left) / 2) if width > 0 else None


def _travel(shapes: Solids, side: str, name: str, pose_tcp_object: Pose) -> float | None:
    """Travel, m, of a finger's pads inwards from open to contact with an object; None without contact."""
    pads, parts = shapes.pads[side], shapes.objects[name]
    opening = shapes.scene.arm.hand.opening
    there = parts.at(pose_tcp_object.position[None], pose_tcp_object.rotation[None])
    closed, travel = pads.at(np.zeros((1, 3)), np.eye(3)[None]), 0.0
    # Sphere tracing: a pad may advance by its distance to the object without passing it.
    for _ in range(APPROACHES):
        aside = np.array([0.0, SIDES[side] * (opening / 2 - travel), 0.0])
        closing = Frames(closed.positions + aside, closed.rotations)
        apart = np.inf
        for i, pad in enumerate(pads.geoms):
            for j, part in enumerate(parts.geoms):
                apart = min(apart, shapes.distance(pad, closing, i, part, there, j))
        if apart < MEETS:
            return travel
        travel += apart
        if travel >= opening:
            return None
    return travel
