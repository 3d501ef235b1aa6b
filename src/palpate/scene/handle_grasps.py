"""Grasps of handles, from the geometry of a scene."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from palpate.common.outline import Convex, Obstacle
from palpate.common.pose import Array, Joint, Pose
from palpate.mjcf.body import Body, BodyDescription
from palpate.mjcf.shapes import RESTING
from palpate.robots.description import RobotDescription
from palpate.robots.grasp import Grasp, derive_grasp
from palpate.robots.kinematics import LIMIT_MARGIN, within_joint_limits
from palpate.robots.pace import configuration
from palpate.scene.resolve import ResolvedScene


@dataclass(frozen=True, eq=False)
class Geometry:
    """Geometry of the scene: objects, surfaces and obstacles."""

    objects: Mapping[str, list[Convex]]  # geoms of each object, in the world
    handles: Mapping[str, list[Convex]]  # geoms of each fixture's handle, in the world
    clouds: Mapping[str, Array]  # (n, 3) points of all geoms of each object
    tops: Mapping[str, Array]  # (n, 3) points of each surface's carrier
    # Owner ("" without one) and points (n, 3) of every colliding geom except planes.
    solids: Sequence[tuple[str, Array]]
    bodies: Mapping[str, Body]
    base: Pose
    arm: RobotDescription

    @classmethod
    def of(
        cls, resolved: ResolvedScene, bodies: Mapping[str, Body], base: Pose, arm: RobotDescription
    ) -> Geometry:
        """Collect the geometry of the compiled scene."""
        shapes = resolved.shapes
        objects: dict[str, list[Convex]] = {}
        handles: dict[str, list[Convex]] = {}
        carriers: dict[str, int] = {}
        movable: set[int] = set()
        # Objects are obstacles under their own names; all other geoms are fixed.
        for name, body in resolved.description.bodies.items():
            if body.role == "surface":
                carriers[name] = shapes.geom_ids[body.carrier]
                continue
            if body.role == "fixture":
                handle = body.handle
                handles[name] = [shapes.convex(geom) for geom in handle]
                movable |= {shapes.geom_ids[geom] for geom in handle}
                continue
            objects[name] = [shapes.convex(geom) for geom in body.elements.colliding]
            movable |= {shapes.geom_ids[geom] for geom in body.elements.geoms}
        # Obstacles with their owners: objects and handles, then all other colliding geoms.
        solids: list[tuple[str, Array]] = []
        for name, geoms in (*objects.items(), *handles.items()):
            solids += [(name, geom.points) for geom in geoms]
        owner = {i: name for name, i in carriers.items()}
        for i in shapes.solid_geoms():
            if i not in movable:
                solids.append((owner.get(i, ""), shapes.geom_points(i)))
        clouds: dict[str, Array] = {}
        for name, geoms in objects.items():
            clouds[name] = np.concatenate([geom.points for geom in geoms])
        tops = {name: shapes.geom_points(i) for name, i in carriers.items()}
        return cls(objects, handles, clouds, tops, solids, bodies, base, arm)

    @cached_property
    def obstacles(self) -> list[tuple[str, Obstacle]]:
        """The solids as seen from above."""
        return [(owner, Obstacle.of(points)) for owner, points in self.solids]

    def others(self, *names: str | None) -> list[Obstacle]:
        """Obstacles except the named objects and surfaces; None names nothing."""
        return [obstacle for owner, obstacle in self.obstacles if owner not in names]

    def on(self, surface: str) -> list[Array]:
        """Points (n, 3) of each object on a surface."""
        top = self.bodies[surface]
        standing: list[Array] = []
        for cloud in self.clouds.values():
            # On the surface: bottom at its top, and middle over it.
            rests = abs(cloud[:, 2].min() - top.top_z()) < RESTING
            if rests and top.covers(*middle(cloud)):
                standing.append(cloud)
        return standing

    def support(self, name: str) -> str | None:
        """The highest surface below an object."""
        cloud = self.clouds[name]
        below: list[Body] = []
        for body in self.bodies.values():
            is_under = body.role == "surface" and body.covers(*middle(cloud))
            if is_under and body.top_z() < cloud[:, 2].min() + RESTING:
                below.append(body)
        highest = max(below, key=lambda body: body.top_z(), default=None)
        return None if highest is None else highest.name


def middle(cloud: Array) -> tuple[float, float]:
    """Middle of (n, 3) points seen from above."""
    x, y = (cloud.max(axis=0) + cloud.min(axis=0))[:2] / 2
    return float(x), float(y)


# Grasps of handles: from above, else level from a side with room for the hand.


RETREAT = 0.12  # m, retreat of a level hand from a handle: fingers and handle are about 6 cm deep
LEAST_AWAY = 0.3  # Least cosine between the arm's direction to a handle and that of an approach
DOWN = -0.5  # World z of the tool's unit z axis below which the hand counts as pointing down
# Half a turn about the tool's z, after which the fingers close along the same line.
HALF_TURN = Pose.of((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def handle_grasp(
    arm: RobotDescription,
    joint: Joint,
    handle: Sequence[Convex],
    around: Sequence[Array],
    base: Pose,
    is_named: bool,
) -> Grasp:
    """The grasp of a handle of convex shapes (world) among solids of points (n, 3).

    Its yaw is the direction of the joint's motion. A handle without a name (`is_named`) may be a whole
    front, and is grasped only from above.
    """
    middle = np.concatenate([shape.points for shape in handle]).mean(axis=0)
    tangent = joint.direction(middle)
    obstacles = [Obstacle.of(points) for points in around]
    # A grasp from above is preferred.
    above = derive_grasp(arm, handle, obstacles, float(np.arctan2(tangent[1], tangent[0])), base)
    if not (above.problem and is_named):
        return above
    # Level approaches, the one that leads straightest away from the arm first.
    for direction in _level(tangent, handle, middle - base.position):
        grasp = _grasp_along(direction, arm, handle, around, base)
        if grasp is not None:
            return grasp
    return replace(above, problem=f"{above.problem}, from above or from its front")


def _level(tangent: Array, handle: Sequence[Convex], away: Array) -> Iterator[Array]:
    """Level unit directions (3,) of an approach to a handle."""
    # They are along and across the handle's motion `tangent` (3,), and along and across the narrowest
    # width of each of its parts. They lead `away` (3,) from the arm, sorted by the cosine to it.
    angles = [float(np.arctan2(tangent[1], tangent[0])), *(_narrowest(shape) for shape in handle)]
    turns = np.add.outer(angles, np.arange(4) * np.pi / 2).ravel()
    whole = np.unique(np.round(np.degrees(turns)) % 360.0)
    directions = np.radians(whole).astype(np.float64)
    horizontal = np.column_stack([np.cos(directions), np.sin(directions), np.zeros(len(whole))])
    # Keep directions away from the arm, in descending order of the cosine.
    ahead = horizontal @ away / float(np.linalg.norm(away))
    for i in np.argsort(-ahead, kind="stable").tolist():
        if ahead[i] > LEAST_AWAY:
            yield horizontal[i].astype(np.float64)


def _narrowest(shape: Convex) -> float:
    """Angle (rad) of the level direction in which a shape is narrowest."""
    # Width in each direction: extent of the projections, in steps of 1°.
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
    """The grasp of a hand that approaches along a level unit `direction` (3,); None if it fits nowhere."""
    # Rotate the scene so that the approach points down, and derive a top-down grasp.
    frame = Pose.turn(-np.pi / 2 * np.array([-direction[1], direction[0], 0.0]))
    rotated = [Convex(shape.points @ frame.rotation, shape.edges) for shape in handle]
    obstacles = [Obstacle.of(points @ frame.rotation) for points in around]
    up = frame.rotation[2]
    yaw = float(np.arctan2(up[1], up[0]))
    grasp = derive_grasp(arm, rotated, obstacles, yaw, frame.inverse() @ base)
    if grasp.problem:
        return None
    # Of the grasp and its half turn, take the reachable one with the smaller turn of the wrist.
    # Both the handle and the retreat must be in reach.
    reached: list[tuple[float, Pose]] = []
    for pose in (frame @ grasp.pose, frame @ grasp.pose @ HALF_TURN):
        back = pose.translate(-RETREAT * direction)
        bent = [configuration(arm, base.inverse() @ candidate) for candidate in (pose, back)]
        if all(within_joint_limits(arm, q, LIMIT_MARGIN) for q in bent):
            reached.append((max(float(abs(q - arm.home)[-1]) for q in bent), pose))
    if not reached:
        return None
    return replace(grasp, pose=min(reached, key=lambda candidate: candidate[0])[1])


def points_down(pose_world_tcp: Pose) -> bool:
    """True for a hand that points down, and is not level."""
    return bool(pose_world_tcp.rotation[2, 2] < DOWN)


def fixtures_without_grasp(
    bodies: Mapping[str, BodyDescription], grasps: Mapping[str, Grasp], given: Collection[str]
) -> dict[str, str]:
    """Fixtures without a graspable handle, with the reason.

    They have no `given` grasp and no geom with a name of a handle, and the hand fits none of their geoms.
    """
    reason = (
        "; no colliding geom has the name of a handle (handle, knob, grip, latch, lever), so all were tried: "
        "name one, or give a grasp in poses.yaml"
    )
    return {
        name: grasp.problem + reason
        for name, grasp in grasps.items()
        if grasp.problem and name not in given and not bodies[name].named_handle
    }
