"""Motion profile of a straight path: speed limits by place.

The impulse of a collision is m (1 + e) v, with the arm's effective mass m in the direction of
motion and the restitution e. The arm moves at free speed only where no contact is possible. Within
the uncertainty of poses from any body it moves slowly and monitors the contact force:

    speed |   ________________
          |  /                \
          | /                  \\___________     near bodies
          |/                                \
          +------------------------------------> path

Motions up and down over one object have the same profile, with empty fingers or with the object held.
Weighing compares equal passes over one path.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Pose
from palpate.primitives.rules.clearance import is_vertical
from palpate.primitives.rules.collision_geometry import near_spans
from palpate.primitives.rules.solids import solids
from palpate.primitives.rules.support import clear_of_support
from palpate.primitives.state import SymbolicState
from palpate.robots.pace import contact_speed
from palpate.robots.trajectory import Stretch, rotate_quaternion
from palpate.scene.scene import Scene

POSE_ERROR = 0.020  # m, largest error of a believed pose that does not state a larger one
# m/s. Both fingers on a table stay below 65 N (mean over 10 ms) and 45 N (mean over 20 ms). This
# holds also where the arm's effective mass is largest (28 kg, close to its base).
GUARDED_SPEED = 0.018
# m/s, largest speed near bodies, where the arm's effective mass is small. The arm goes 3 mm in the
# 60 ms until a contact is certain. A free object may be moved by 5 mm.
NEAR_SPEED = 0.05
LIFT_OFF = 0.010  # m of slow motion as the arm leaves an object or a surface
# m above the start up to which the arm then moves fast, since the hand just came from there.
RETRACED = 0.10
CELL = 0.005  # m of a path: resolution of the profile
SHORTEST = 0.015  # m: a shorter free stretch is merged into its neighbours
Cells = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class PathSpan:
    """A part of a straight path."""

    # start, end: poses of the TCP in the world
    start: Pose
    end: Pose
    guarded: bool  # contact is possible here


def spans(state: SymbolicState, start: Pose, end: Pose) -> Iterator[PathSpan]:
    """Spans of the TCP's straight path from `start` to `end` (world), in order, as `state` believes."""
    near = _near(state, start, end)
    for first, last in pairwise(_edges(near)):
        one = between(state, start, end, first / len(near))
        other = between(state, start, end, last / len(near))
        yield PathSpan(one, other, bool(near[first]))


def stretches(parts: Sequence[PathSpan], scene: Scene) -> list[Stretch]:
    """Stretches of a path with their speed limits."""
    lengths = [part.start.distance_to(part.end) for part in parts]
    whole = max(sum(lengths), 1e-9)
    return [
        Stretch(end / whole, speed(part, scene))
        for part, end in zip(parts, accumulate(lengths), strict=True)
    ]


def speed(span: PathSpan, scene: Scene) -> float:
    """Speed limit of a span, m/s."""
    if not span.guarded:
        return scene.arm.pace.speed  # the robot itself slows down where the arm is heavy
    # Near a body, the effective mass along the direction of motion limits the speed.
    way = span.end.position - span.start.position
    length = float(np.linalg.norm(way))
    if length < CELL:
        return GUARDED_SPEED
    direction = scene.pose_world_base.rotation.T @ way / length
    pose_base_tcp = scene.pose_world_base.inverse() @ span.start
    return min(contact_speed(scene.arm, pose_base_tcp, direction), NEAR_SPEED)


def leaves(start: Pose, end: Pose) -> bool:
    """True for a path straight up, back along the way that the hand came down."""
    return is_vertical(start, end) and bool(end.position[2] > start.position[2])


def between(state: SymbolicState, start: Pose, end: Pose, share: float) -> Pose:
    """Pose at a share of the straight path, the rotation interpolated as well."""
    if share <= 0.0:
        return start
    if share >= 1.0:
        return end
    position = start.position + share * (end.position - start.position)
    turn = share * solids(state.scene).turn(start, end)
    return Pose.of(position, rotate_quaternion(start.quaternion, turn[None])[0])


def _near(state: SymbolicState, start: Pose, end: Pose) -> Cells:
    """Mask of the path's cells within the pose error of some body."""
    near = np.zeros(max(1, int(np.ceil(start.distance_to(end) / CELL))), dtype=np.bool_)
    # Mark the cells that are near with the state now, or with the state of the way back.
    error = max([POSE_ERROR, *(body.doubt for body in state.scene.bodies.values())])
    for hand in _both_ways(state, start, end):
        for first, last in near_spans(hand, start, end, error):
            near[int(first * len(near)) : int(np.ceil(last * len(near)))] = True
    if leaves(start, end):
        # After lift-off the hand retraces its way down, which was free.
        clear = np.flatnonzero(~near)
        left = int(clear[0]) if len(clear) else len(near)
        near[min(left, round(LIFT_OFF / CELL)) : min(left, round(RETRACED / CELL))] = False
    for first, last in pairwise(_edges(near)):
        # A free stretch shorter than `SHORTEST` gets the low speed of its neighbours.
        whole = last - first == len(near)
        if not near[first] and last - first < round(SHORTEST / CELL) and not whole:
            near[first:last] = True
    return near


def _edges(near: Cells) -> list[int]:
    """Starts of the stretches, and the end."""
    return [0, *(np.flatnonzero(np.diff(near)) + 1).tolist(), len(near)]


def _both_ways(state: SymbolicState, start: Pose, end: Pose) -> Iterator[SymbolicState]:
    """The state and, on the way to or from an object's place, the state on the way back."""
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
            moved = state.place_object(state.holding, placed)
            yield replace(state, gripper="open", holding=None, pose_tcp_object=None, moved=moved)
