"""Grasps of handles: from above, else level, from whichever side leaves room for the hand.

What stands above a handle does not stand in front of it:

           | hand                    +---+
        +--+--+                      |   |   +------
        |     |  handle              | # |===| hand
        +-----+                      |   |   +------

A level grasp is derived as one from above, in a frame whose z axis points against the approach.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from palpate.geometry.joint import Joint
from palpate.geometry.outline import Convex, Obstacle
from palpate.geometry.pose import Array, Pose
from palpate.mjcf.body import BodyDescription
from palpate.robots.description import RobotDescription
from palpate.robots.grasp import Grasp, derive_grasp
from palpate.robots.kinematics import LIMIT_MARGIN, within_joint_limits
from palpate.robots.pace import configuration

RETREAT = 0.12
"""m that a level hand goes back from a handle: its fingers, and what is grasped, are some 6 cm deep."""
LEAST_AWAY = 0.3
"""Cosine between the arm's direction to a handle and that of an approach, at least."""
DOWN = -0.5
"""Height of the tool's z axis, a unit vector, below which the hand counts as pointing down."""
HALF_TURN = Pose.of((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
"""About the tool's z: the fingers close in the same way."""


def handle_grasp(
    arm: RobotDescription,
    joint: Joint,
    handle: Sequence[Convex],
    around: Sequence[Array],
    base: Pose,
    is_named: bool,
) -> Grasp:
    """The grasp of a handle of convex shapes (world) among solids of points (n, 3); its yaw is that of the joint's
    way. What is not named a handle may be a whole front, and is grasped from above alone."""
    middle = np.concatenate([shape.points for shape in handle]).mean(axis=0)
    way = joint.direction(middle)
    obstacles = [Obstacle.of(points) for points in around]
    above = derive_grasp(arm, handle, obstacles, float(np.arctan2(way[1], way[0])), base)
    if not (above.problem and is_named):
        return above
    for direction in _level(way, handle, middle - base.position):
        found = _grasp_along(direction, arm, handle, around, base)
        if found is not None:
            return found
    return replace(above, problem=f"{above.problem}, from above or from its front")


def _level(way: Array, handle: Sequence[Convex], away: Array) -> Iterator[Array]:
    """Level directions (3,), unit, along and across the way (3,) of a handle and each of its parts where these are
    narrowest, that lead `away` (3,) from the arm, most so first."""
    angles = [float(np.arctan2(way[1], way[0])), *(_narrowest(shape) for shape in handle)]
    turns = np.add.outer(angles, np.arange(4) * np.pi / 2).ravel()
    whole = np.unique(np.round(np.degrees(turns)) % 360.0)
    directions = np.radians(whole).astype(np.float64)
    found = np.column_stack([np.cos(directions), np.sin(directions), np.zeros(len(whole))])
    ahead = found @ away / float(np.linalg.norm(away))
    for i in np.argsort(-ahead, kind="stable").tolist():
        if ahead[i] > LEAST_AWAY:
            yield found[i].astype(np.float64)


def _narrowest(shape: Convex) -> float:
    """Angle (rad) of the level direction in which a shape is narrowest."""
    grid = np.radians(np.arange(180))
    along = shape.points[:, :2] @ np.array([np.cos(grid), np.sin(grid)])
    return float(grid[np.argmin(np.ptp(along, axis=0))])


def _grasp_along(
    direction: Array,
    arm: RobotDescription,
    handle: Sequence[Convex],
    around: Sequence[Array],
    base: Pose,
) -> Grasp | None:
    """The grasp of a hand that comes along a level `direction` (3,), unit; None where it does not fit, or is out of
    reach."""
    frame = Pose.turn(-np.pi / 2 * np.array([-direction[1], direction[0], 0.0]))
    turned = [Convex(shape.points @ frame.rotation, shape.edges) for shape in handle]
    obstacles = [Obstacle.of(points @ frame.rotation) for points in around]
    up = frame.rotation[2]
    yaw = float(np.arctan2(up[1], up[0]))
    found = derive_grasp(arm, turned, obstacles, yaw, frame.inverse() @ base)
    if found.problem:
        return None
    # Of both ways round that within reach, at the handle and behind it, that turns the wrist less.
    reached: list[tuple[float, Pose]] = []
    for pose in (frame @ found.pose, frame @ found.pose @ HALF_TURN):
        back = pose.translated(-RETREAT * direction)
        bent = [configuration(arm, base.inverse() @ one) for one in (pose, back)]
        if all(within_joint_limits(arm, q, LIMIT_MARGIN) for q in bent):
            reached.append((max(float(abs(q - arm.home)[6]) for q in bent), pose))
    if not reached:
        return None
    return replace(found, pose=min(reached, key=lambda one: one[0])[1])


def front_of(
    arm: RobotDescription, name: str, pose_world_tcp: Pose, base: Pose
) -> dict[str, Array]:
    """Joint configurations (7,), rad, by which a level hand comes to a pose in front of a fixture: first the wrist
    turns, as the arm is at home, then the arm moves. (Stretched, with a wrist in line, it could not feel a contact.)
    """
    front = configuration(arm, base.inverse() @ pose_world_tcp)
    return {f"{name}_level": np.array([*arm.home[:5], *front[5:]]), f"{name}_front": front}


def points_down(pose_world_tcp: Pose) -> bool:
    """True for a hand that is not level."""
    return bool(pose_world_tcp.rotation[2, 2] < DOWN)


def unnamed(
    bodies: Mapping[str, BodyDescription], held: Mapping[str, Grasp], given: Collection[str]
) -> dict[str, str]:
    """Fixtures that the hand cannot grasp, without a grasp `given`, that have no geom called a handle; with the
    reason."""
    why = (
        "; none of its colliding geoms is called a handle (handle, knob, grip, latch, lever), so that all of them "
        "were tried: name one, or give a grasp in poses.yaml"
    )
    return {
        name: grasp.problem + why
        for name, grasp in held.items()
        if grasp.problem and name not in given and not bodies[name].named_handle
    }
