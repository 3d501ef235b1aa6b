"""Motion profile of a straight path: speed limits by place.

Impulse decides what a collision does: m (1 + e) v, with the arm's effective mass m in the direction
of motion. So the arm goes at free speed only where nothing can be, and slowly, feeling its way,
where something is, or may be by the uncertainty of poses:

    speed |   ________________
          |  /                \\
          | /                  \\___________     near things
          |/                                \\
          +------------------------------------> way

A way up and down over one object has one profile, whether the fingers are empty or hold it, because
weighing compares equal passes over one path.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise

import numpy as np
from numpy.typing import NDArray

from palpate.geometry.pose import Pose
from palpate.robots.pace import contact_speed
from palpate.robots.trajectory.path import rotation_vector, turned
from palpate.robots.trajectory.straight import Stretch
from palpate.scene.scene import Scene
from palpate.vocabulary.admissible.clearance import STEEP
from palpate.vocabulary.admissible.support import clear_of_support
from palpate.vocabulary.admissible.sweep.collision_geometry import near_spans
from palpate.vocabulary.state import SymbolicState

POSE_ERROR = 0.020
"""m: how far things may be from where they are believed to be."""
GUARDED_SPEED = 0.018
"""m/s at which both fingers on a table stay below 65 N (mean over 10 ms) and 45 N (20 ms), also where
the arm is heaviest (28 kg, close to its base)."""
NEAR_SPEED = 0.05
"""m/s near things, where the arm is light: it goes 3 mm in the 60 ms in which it is certain that it
has met something, and what stands freely is not to be moved by 5."""
LIFT_OFF = 0.010
"""m: how far the arm goes slowly as it leaves what it stood at ..."""
RETRACED = 0.10
"""m: ... and how far up it then goes where the hand just came from."""
CELL = 0.005
"""m of a way that has one speed at least."""
SHORTEST = 0.015
"""m: a shorter stretch is not worth another speed."""

Cells = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Span:
    """A part of a way.

    Attributes:
        start, end: poses of the TCP in the world.
        guarded: something may be met here.
    """

    start: Pose
    end: Pose
    guarded: bool


def spans(state: SymbolicState, start: Pose, end: Pose) -> Iterator[Span]:
    """The straight way of the TCP from `start` to `end` (world) in parts, in order, by what `state`
    believes."""
    near = _near(state, start, end)
    for first, last in pairwise(_edges(near)):
        one = between(start, end, first / len(near))
        other = between(start, end, last / len(near))
        yield Span(one, other, bool(near[first]))


def stretches(parts: Sequence[Span], scene: Scene) -> list[Stretch]:
    """Stretches of a path with their speed limits."""
    lengths = [part.start.distance_to(part.end) for part in parts]
    whole = max(sum(lengths), 1e-9)
    return [
        Stretch(end / whole, speed(part, scene))
        for part, end in zip(parts, accumulate(lengths), strict=True)
    ]


def speed(span: Span, scene: Scene) -> float:
    """m/s, the fastest on a span."""
    if not span.guarded:
        return scene.arm.pace.speed  # the arm goes more slowly where it is heavy
    way = span.end.position - span.start.position
    length = float(np.linalg.norm(way))
    if length < CELL:
        return GUARDED_SPEED
    direction = scene.pose_world_base.rotation.T @ way / length
    met = scene.pose_world_base.inverse() @ span.start
    return min(contact_speed(scene.arm, met, direction), NEAR_SPEED)


def between(start: Pose, end: Pose, share: float) -> Pose:
    """The pose at a share of the straight way; the hand turns evenly along it."""
    if share <= 0.0:
        return start
    if share >= 1.0:
        return end
    position = start.position + share * (end.position - start.position)
    turn = share * rotation_vector(start.quaternion, end.quaternion)
    return Pose.of(position, turned(start.quaternion, turn[None])[0])


def leaves(start: Pose, end: Pose) -> bool:
    """True if a way goes straight up: what is near its start it leaves, and goes where the hand
    came from."""
    way = end.position - start.position
    return float(np.linalg.norm(way[:2])) < STEEP and float(way[2]) > 0.0


def _near(state: SymbolicState, start: Pose, end: Pose) -> Cells:
    """Mask of the path's cells that are near something."""
    near = np.zeros(max(1, int(np.ceil(start.distance_to(end) / CELL))), dtype=np.bool_)
    for hand in _with_and_without(state, start, end):
        for first, last in near_spans(hand, start, end, POSE_ERROR):
            near[int(first * len(near)) : int(np.ceil(last * len(near)))] = True
    if leaves(start, end):
        _lift_off(near)
    _smooth(near)
    return near


def _lift_off(near: Cells) -> None:
    """Near the start, the way back is free after a little."""
    clear = np.flatnonzero(~near)
    left = int(clear[0]) if len(clear) else len(near)
    near[min(left, _cells(LIFT_OFF)) : min(left, _cells(RETRACED))] = False


def _smooth(near: Cells) -> None:
    """Free stretches that are too short for a speed of their own go as slowly as what is beside
    them."""
    for first, last in pairwise(_edges(near)):
        whole = last - first == len(near)
        if not near[first] and last - first < _cells(SHORTEST) and not whole:
            near[first:last] = True


def _edges(near: Cells) -> list[int]:
    """Starts of the stretches, and the end."""
    return [0, *(np.flatnonzero(np.diff(near)) + 1).tolist(), len(near)]


def _cells(length: float) -> int:
    return round(length / CELL)


def _with_and_without(state: SymbolicState, start: Pose, end: Pose) -> Iterator[SymbolicState]:
    """The hand as it is and, on the way to or from an object's place, as it is on the way back."""
    yield state
    low = min(start, end, key=lambda pose: float(pose.position[2]))
    if state.holding is None:
        body = state.object_at(low)
        if body is not None:
            held = low.inverse() @ state.pose_of(body.name)
            yield replace(state, gripper="closed", holding=body.name, pose_tcp_object=held)
    elif state.pose_tcp_object is not None:
        placed = low @ state.pose_tcp_object
        if not clear_of_support(state, state.holding, placed):
            moved = {**state.moved, state.holding: placed}
            yield replace(state, gripper="open", holding=None, pose_tcp_object=None, moved=moved)
