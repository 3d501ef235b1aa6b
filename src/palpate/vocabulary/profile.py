"""How fast the arm goes where: the motion profile of a straight way.

Impulse decides what a collision does: m (1 + e) v, with the arm's effective mass m in the direction
of motion. So the arm goes at free speed only where nothing can be, and slowly, feeling its way,
where something is, or may be by the uncertainty of poses:

    speed |   ________________
          |  /                \\
          | /                  \\_______        near objects
          |/                            \\____   near what is fixed, and before every stop
          +------------------------------------> way

A way up and down over one object has one profile, whether the fingers are empty or hold it, because
weighing compares equal passes over one path.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from palpate.geometry.pose import Array, Pose
from palpate.robots.pace import contact_speed
from palpate.robots.trajectory import rotation_vector, turned
from palpate.scene.scene import Scene
from palpate.vocabulary.admissible.clearance import STEEP
from palpate.vocabulary.admissible.support import clear_of_support
from palpate.vocabulary.admissible.sweep import near_spans
from palpate.vocabulary.state import SymbolicState

POSE_ERROR = 0.020
"""m: how far things may be from where they are believed to be."""
GUARDED_SPEED = 0.018
"""m/s at which both fingers on a table stay below 65 N (mean over 10 ms) and 45 N (20 ms), also where
the arm is heaviest (28 kg, close to its base)."""
OBJECT_SPEED = 0.035
"""m/s near what stands freely: a fingertip on the top of a can stays below 65 and 45 N."""
LAST = 0.020
"""m before the end of a way near anything that are gone as near what is fixed: what is grasped may
be higher than believed, and then the palm meets it."""
LIFT_OFF = 0.010
"""m: how far the arm goes slowly as it leaves what it stood at ..."""
RETRACED = 0.10
"""m: ... and how far up it then goes where the hand just came from."""
CELL = 0.005
"""m of a way that has one speed at least."""
SHORTEST = 0.015
"""m: a shorter stretch is not worth another speed."""

FREE, OBJECT, FIXED = 0, 1, 2
"""What a stretch of the way is near."""
Levels = NDArray[np.intp]
AWAY = Pose.of((0.0, 0.0, -100.0))
"""Where nothing is near."""


@dataclass(frozen=True, slots=True)
class Span:
    """A part of a way.

    Attributes:
        start, end: poses of the TCP in the world.
        near: what something met here would be, or `FREE`.
    """

    start: Pose
    end: Pose
    near: int

    @property
    def guarded(self) -> bool:
        """Whether something may be met here."""
        return self.near != FREE


def spans(state: SymbolicState, start: Pose, end: Pose) -> Iterator[Span]:
    """The straight way of the TCP from `start` to `end` (world) in parts, in order, by what `state`
    believes."""
    levels = _levels(state, start, end)
    edges = [0, *(np.flatnonzero(np.diff(levels)) + 1).tolist(), len(levels)]
    for first, last in pairwise(edges):
        one = between(start, end, first / len(levels))
        other = between(start, end, last / len(levels))
        yield Span(one, other, int(levels[first]))


def speed(span: Span, scene: Scene, q: Array) -> float:
    """m/s, the fastest on a span that begins at joint angles `q` (7,), rad."""
    if span.near == FREE:
        return scene.arm.pace.speed  # the arm goes more slowly where it is heavy
    if span.near == OBJECT:
        return OBJECT_SPEED
    way = span.end.position - span.start.position
    length = float(np.linalg.norm(way))
    if length < CELL:
        return GUARDED_SPEED
    direction = scene.pose_world_base.rotation.T @ way / length
    return min(contact_speed(scene.arm, q, direction), OBJECT_SPEED)


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
    """Whether a way goes straight up: what is near its start it leaves, and goes where the hand
    came from."""
    way = end.position - start.position
    return float(np.linalg.norm(way[:2])) < STEEP and float(way[2]) > 0.0


def _levels(state: SymbolicState, start: Pose, end: Pose) -> Levels:
    """What each cell of the way is near."""
    levels = np.full(max(1, int(np.ceil(start.distance_to(end) / CELL))), FREE)
    for hand in _with_and_without(state, start, end):
        _raise(levels, near_spans(hand, start, end, POSE_ERROR), OBJECT)
        _raise(levels, near_spans(_among_fixed(hand), start, end, POSE_ERROR), FIXED)
    if leaves(start, end):
        _lift_off(levels)
    if levels[-1] != FREE:
        levels[-_cells(LAST) :] = FIXED
    _smooth(levels)
    return levels


def _raise(levels: Levels, near: Iterable[tuple[float, float]], level: int) -> None:
    for first, last in near:
        cells = slice(int(first * len(levels)), int(np.ceil(last * len(levels))))
        levels[cells] = np.maximum(levels[cells], level)


def _lift_off(levels: Levels) -> None:
    """Near the start, the way back is free after a little."""
    clear = np.flatnonzero(levels == FREE)
    near = int(clear[0]) if len(clear) else len(levels)
    first = min(near, _cells(LIFT_OFF))
    levels[:first] = FIXED
    levels[first : min(near, _cells(RETRACED))] = FREE


def _smooth(levels: Levels) -> None:
    """Stretches that are too short for a speed of their own go as slowly as a neighbour."""
    for level in (FREE, OBJECT):
        edges = [0, *(np.flatnonzero(np.diff(levels)) + 1).tolist(), len(levels)]
        for first, last in pairwise(edges):
            whole = last - first == len(levels)
            if levels[first] == level and last - first < _cells(SHORTEST) and not whole:
                around = levels[max(first - 1, 0)], levels[min(last, len(levels) - 1)]
                levels[first:last] = max(*around, level)


def _cells(length: float) -> int:
    return round(length / CELL)


def _among_fixed(state: SymbolicState) -> SymbolicState:
    """As if no object stood anywhere."""
    nowhere = {name: AWAY for name in state.scene.objects if name != state.holding}
    return replace(state, moved={**state.moved, **nowhere})


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
