"""Geometry of a scene from which its named poses are derived."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from palpate.geometry.outline import Convex, Obstacle
from palpate.geometry.pose import Array, Pose
from palpate.mjcf.body import Body
from palpate.mjcf.shapes import RESTING
from palpate.robots.description import RobotDescription
from palpate.scene.resolve import ResolvedScene


@dataclass(frozen=True, eq=False)
class Geometry:
    """Geometry of the scene: objects, surfaces and obstacles.

    Attributes:
        objects: geoms of each object, in the world.
        handles: geoms of each fixture's handle, in the world.
        clouds: (n, 3) points of all geoms of each object.
        tops: (n, 3) points of each surface's carrier.
        solids: owner ("" without one) and points (n, 3) of every colliding geom except planes.
    """

    objects: Mapping[str, list[Convex]]
    handles: Mapping[str, list[Convex]]
    clouds: Mapping[str, Array]
    tops: Mapping[str, Array]
    solids: Sequence[tuple[str, Array]]
    bodies: Mapping[str, Body]
    base: Pose
    arm: RobotDescription

    @classmethod
    def of(
        cls,
        resolved: ResolvedScene,
        bodies: Mapping[str, Body],
        base: Pose,
        arm: RobotDescription,
    ) -> Geometry:
        """From the compiled scene."""
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
        """Points of each object that stands on a surface."""
        top = self.bodies[surface]
        standing: list[Array] = []
        for cloud in self.clouds.values():
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
