"""How fast the arm goes where: the motion profile of a straight way.

Impulse decides what a collision does: m (1 + e) v, with the arm's effective mass m in the direction
of motion. So the arm goes at free speed only where nothing can be, and slowly, feeling its way,
where something is, or may be by the uncertainty of poses:

    speed |   ________________
          |  /                \\
          | /                  \\_____________   guarded
          +------------------------------------> way
            free                near things

A way up and down over one object has one profile, whether the fingers are empty or hold it, because
weighing compares equal passes over one path.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from palpate.geometry.pose import Pose
from palpate.robots.trajectory import rotation_vector, turned
from palpate.vocabulary.admissible.clearance import STEEP
from palpate.vocabulary.admissible.support import clear_of_support
from palpate.vocabulary.admissible.sweep import near_spans
from palpate.vocabulary.state import SymbolicState

POSE_ERROR = 0.020
"""m: how far things may be from where they are believed to be."""
GUARDED_SPEED = 0.020
"""m/s near things: a contact at this speed stays below 65 N (mean over 10 ms) and 45 N (20 ms), also
where the arm is heaviest (18-30 kg, radially)."""
FREE_SPEED = (0.15, 0.25, 0.10)
"""m/s where nothing is near: away from or towards the base, around it, and up or down. The arm is
heavy radially (18-30 kg at the TCP), light around the base (6-9 kg)."""
LIFT_OFF = 0.010
"""m: how far the arm goes slowly as it leaves what it stood at; the rest of the way up is the one
that it came down."""
SHORTEST_FREE = 0.015
"""m: a shorter stretch between two near things is not worth going faster."""


@dataclass(frozen=True, slots=True)
class Span:
    """A part of a way.

    Attributes:
        start, end: poses of the TCP in the world. speed: m/s.
        guarded: something may be met here.
    """

    start: Pose
    end: Pose
    speed: float
    guarded: bool


def spans(state: SymbolicState, start: Pose, end: Pose) -> Iterator[Span]:
    """The straight way of the TCP from `start` to `end` (world) in parts, in order, by what `state`
    believes."""
    edges = [0.0]
    slow: list[bool] = []
    for first, last in _slow(state, start, end):
        if first > edges[-1]:
            edges.append(first)
            slow.append(False)
        edges.append(last)
        slow.append(True)
    if edges[-1] < 1.0 or not slow:
        edges.append(1.0)
        slow.append(False)
    poses = [between(start, end, share) for share in edges]
    for one, other, guarded in zip(poses, poses[1:], slow, strict=False):
        speed = GUARDED_SPEED if guarded else free_speed(state, one, other)
        yield Span(one, other, speed, guarded)


def free_speed(state: SymbolicState, start: Pose, end: Pose) -> float:
    """m/s at which the arm may go from `start` to `end` where nothing is near."""
    way = end.position - start.position
    length = float(np.linalg.norm(way))
    if length < 1e-6:
        return min(FREE_SPEED)
    away = start.position - state.scene.pose_world_base.position
    radial = away[:2] / max(float(np.linalg.norm(away[:2])), 1e-6)
    outwards = float(way[:2] @ radial)
    around = float(np.linalg.norm(way[:2] - outwards * radial))
    shares = np.abs([outwards, around, way[2]]) / length
    return float(1.0 / np.max(shares / FREE_SPEED))


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


def _slow(state: SymbolicState, start: Pose, end: Pose) -> list[tuple[float, float]]:
    """Shares of the way that are gone slowly, in order, none of which touch."""
    length = max(start.distance_to(end), 1e-6)
    near: list[tuple[float, float]] = []
    for hand in _with_and_without(state, start, end):
        near += near_spans(hand, start, end, POSE_ERROR)
    merged: list[tuple[float, float]] = []
    for first, last in sorted(near):
        if merged and first - merged[-1][1] < SHORTEST_FREE / length:
            merged[-1] = (merged[-1][0], max(merged[-1][1], last))
        else:
            merged.append((first, last))
    if merged and merged[0][0] * length < SHORTEST_FREE:
        merged[0] = (0.0, merged[0][1])
    if merged and (1.0 - merged[-1][1]) * length < SHORTEST_FREE:
        merged[-1] = (merged[-1][0], 1.0)
    if merged and merged[0][0] == 0.0 and leaves(start, end):
        merged[0] = (0.0, min(merged[0][1], LIFT_OFF / length))
    return merged


def _with_and_without(state: SymbolicState, start: Pose, end: Pose) -> Iterator[SymbolicState]:
    """The hand as it is and, on the way to or from an object's place, as it is on the way back."""
    yield state
    low = min(start, end, key=lambda pose: float(pose.position[2]))
    if state.holding is None:
        body = state.object_at(low)
        if body is not None:
            held = low.inverse() @ state.pose_of(body.name)
            yield replace(state, holding=body.name, pose_tcp_object=held)
    elif state.pose_tcp_object is not None:
        placed = low @ state.pose_tcp_object
        if not clear_of_support(state, state.holding, placed):
            moved = {**state.moved, state.holding: placed}
            yield replace(state, holding=None, pose_tcp_object=None, moved=moved)
