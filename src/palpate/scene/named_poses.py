"""Symbols that the scene's geometry implies, completed and overruled by `poses.yaml`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.errors import unknown_name
from palpate.geometry.outline import Convex, Obstacle, above, rectangle, rim
from palpate.geometry.pose import Array, Pose
from palpate.mjcf.body import Body
from palpate.mjcf.shapes import RESTING
from palpate.robots.description import RobotDescription
from palpate.robots.grasp import Grasp, derive_grasp
from palpate.scene.places import APPROACH, approach_pose, free_spot
from palpate.scene.poses import Offset, Poses
from palpate.scene.resolve import ResolvedScene
from palpate.scene.symbols import DEFAULT_OFFSETS, Symbols, vectors

LIFT = (0.10, 0.35)
"""m: bounds of a derived `z_offset`."""

USUAL_LIFT = 0.12
"""m: `z_offset` where no neighbour asks for more."""

CORRIDOR = 0.15
"""m: half width of the way from the arm to an object, in which neighbours must be cleared."""

CLEAR = 0.02
"""m: between a carried object's bottom and the top of a neighbour."""


@dataclass(frozen=True, eq=False)
class Geometry:
    """What there is to touch and to keep clear of.

    Attributes:
        objects: object to each of its geoms, in the world. clouds: (n, 3) points of all of them
            together.
        tops: surface to the points of the geom that carries.
        solids: owner ("" for what has no name here) and outline of every colliding geom but planes.
    """

    objects: Mapping[str, list[Convex]]
    clouds: Mapping[str, Array]
    tops: Mapping[str, Array]
    solids: Sequence[tuple[str, Obstacle]]
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
        carriers: dict[str, int] = {}
        movable: set[int] = set()
        for name, body in resolved.description.bodies.items():
            if body.role == "surface":
                carriers[name] = shapes.geom_ids[body.carrier]
                continue
            objects[name] = [shapes.convex(geom) for geom in body.elements.colliding]
            movable |= {shapes.geom_ids[geom] for geom in body.elements.geoms}
        solids: list[tuple[str, Obstacle]] = []
        for name, geoms in objects.items():
            solids += [(name, Obstacle.of(geom.points)) for geom in geoms]
        owner = {i: name for name, i in carriers.items()}
        for i in shapes.solid_geoms():
            if i not in movable:
                solids.append((owner.get(i, ""), Obstacle.of(shapes.geom_points(i))))
        clouds = {n: np.concatenate([g.points for g in geoms]) for n, geoms in objects.items()}
        tops = {name: shapes.geom_points(i) for name, i in carriers.items()}
        return cls(objects, clouds, tops, solids, bodies, base, arm)

    def others(self, *names: str) -> list[Obstacle]:
        """Everything solid but the named objects and surfaces."""
        return [obstacle for owner, obstacle in self.solids if owner not in names]

    def on(self, surface: str) -> list[Array]:
        """The objects that stand on a surface."""
        top = self.bodies[surface]
        return [
            cloud
            for cloud in self.clouds.values()
            if abs(cloud[:, 2].min() - top.top_z()) < RESTING and top.covers(*_middle(cloud))
        ]

    def support(self, name: str) -> str | None:
        """The surface below an object."""
        cloud = self.clouds[name]
        under = [
            b
            for b in self.bodies.values()
            if b.role == "surface"
            and b.covers(*_middle(cloud))
            and b.top_z() < cloud[:, 2].min() + RESTING
        ]
        return max(under, key=lambda b: b.top_z()).name if under else None


def _middle(cloud: Array) -> tuple[float, float]:
    x, y = (cloud.max(axis=0) + cloud.min(axis=0))[:2] / 2
    return float(x), float(y)


def derive_symbols(
    resolved: ResolvedScene, bodies: Mapping[str, Body], base: Pose, arm: RobotDescription
) -> Symbols:
    """All names of the scene: those of poses.yaml, and what geometry implies for the rest."""
    geometry = Geometry.of(resolved, bodies, base, arm)
    entries = resolved.poses
    grasps = {name: _grasp(geometry, name) for name in geometry.objects}
    poses = _poses(geometry, grasps, entries)
    later = {
        f"{n}_temporary": _later(geometry, n, poses[f"{n}_pose"])
        for n in geometry.objects
        if f"{n}_temporary" not in poses
    }
    subjects = {f"{n}_{suffix}": n for n in geometry.objects for suffix in ("pose", "temporary")}
    subjects |= {f"{n}_approach": n for n in geometry.tops}
    common, special = _given_offsets(entries.offsets, geometry.objects)
    own = {n: _own_offsets(geometry, n, g, poses[f"{n}_pose"]) for n, g in grasps.items()}
    return Symbols(
        poses=poses,
        subjects={n: s for n, s in subjects.items() if n in poses or n in later},
        later=later,
        configurations={"home_config": geometry.arm.home}
        | {n: np.array(q) for n, q in entries.joints.items()},
        offsets={n: np.array(v) for n, v in DEFAULT_OFFSETS.items()} | common,
        own_offsets={n: offsets | common | special.get(n, {}) for n, offsets in own.items()},
        ungraspable=_ungraspable(geometry, grasps, entries),
    )


def _poses(geometry: Geometry, grasps: Mapping[str, Grasp], entries: Poses) -> dict[str, Pose]:
    poses = {f"{n}_pose": g.pose for n, g in grasps.items()}
    poses |= {
        f"{n}_pose": geometry.bodies[n].pose_world @ e.tool_pose()
        for n, e in entries.grasps.items()
    }
    poses |= {
        f"{n}_approach": p for n in geometry.tops if (p := _approach(geometry, n)) is not None
    }
    return poses | {n: e.tool_pose() for n, e in entries.places.items()}


def _ungraspable(geometry: Geometry, grasps: Mapping[str, Grasp], entries: Poses) -> dict[str, str]:
    lost = {
        n: "nobody knows where it is; give its pose in poses.yaml"
        for n in geometry.objects
        if "position" in geometry.bodies[n].missing and n not in entries.objects
    }
    return {n: g.problem for n, g in grasps.items() if g.problem and n not in entries.grasps} | lost


def free_place(geometry: Geometry, name: str, pose_world_tcp: Pose) -> Pose | None:
    """TCP pose at which the object, held as at `pose_world_tcp`, stands on a free spot of its
    surface.

    What is stacked on another object is put down on the surface.
    """
    support = geometry.support(name)
    if support is None:
        return None
    cloud = geometry.clouds[name]
    here = np.array(_middle(cloud))
    x, y = geometry.arm.hand.half_extents
    hand = rectangle(pose_world_tcp.position[:2], pose_world_tcp.rotation[:2, 0], x, y / 2)
    shape = rim(np.concatenate([cloud[:, :2], hand])) - here
    footing = np.array([cloud.min(axis=0)[:2], cloud.max(axis=0)[:2]]) - here
    stacked = float(cloud[:, 2].min() - geometry.tops[support][:, 2].max())
    drop = stacked if stacked > RESTING else 0.0
    bottom = float(cloud[:, 2].min()) - drop
    obstacles = above([*geometry.others(name, support), Obstacle.of(cloud)], bottom + 0.002)
    found = free_spot(
        geometry.arm.reach,
        shape,
        footing,
        geometry.tops[support],
        obstacles,
        here,
        bottom,
        geometry.base,
    )
    return None if found is None else pose_world_tcp.translated((*(found[0] - here), -drop))


def _later(geometry: Geometry, name: str, pose: Pose) -> Callable[[], Pose | None]:
    return lambda: free_place(geometry, name, pose)


def _grasp(geometry: Geometry, name: str) -> Grasp:
    """The grasp among the neighbours, else the one there is once other objects are carried away."""
    rotation = geometry.bodies[name].pose_world.rotation
    level = int(np.argmax(np.hypot(rotation[0], rotation[1])))
    yaw = float(np.arctan2(rotation[1, level], rotation[0, level]))
    support = geometry.support(name)
    names = (name,) if support is None else (name, support)
    found = derive_grasp(
        geometry.arm, geometry.objects[name], geometry.others(*names), yaw, geometry.base
    )
    if not found.problem:
        return found
    cleared = geometry.others(*names, *geometry.objects)
    return derive_grasp(geometry.arm, geometry.objects[name], cleared, yaw, geometry.base)


def _approach(geometry: Geometry, name: str) -> Pose | None:
    return approach_pose(
        geometry.arm,
        geometry.tops[name],
        geometry.others(name),
        geometry.on(name),
        APPROACH,
        geometry.base,
    )


def _own_offsets(geometry: Geometry, name: str, grasp: Grasp, pose: Pose) -> dict[str, Array]:
    """Along x half of what the grasp may shift; along y a quarter of the width; along z a clear
    lift."""
    x = max((grasp.slack - geometry.arm.hand.pad) / 2, 0.005)
    y = max(grasp.width / 4, 0.005)
    return {
        "x_offset": np.array([x, 0, 0]),
        "y_offset": np.array([0, y, 0]),
        "z_offset": np.array([0, 0, _lift(geometry, name, pose)]),
    }


def _lift(geometry: Geometry, name: str, pose: Pose) -> float:
    bottom = float(geometry.clouds[name][:, 2].min())
    needed = max(
        (
            other.top + CLEAR - bottom
            for other in geometry.others(name)
            if _on_the_way(other.outline, pose, geometry.base)
        ),
        default=0.0,
    )
    return float(np.clip(max(needed, USUAL_LIFT), *LIFT))


def _on_the_way(outline: Array, pose: Pose, base: Pose) -> bool:
    """Whether something is near the straight way from above the arm's front to the object."""
    start = base.position[:2] + 0.3 * base.rotation[:2, 0]
    way = pose.position[:2] - start
    low, high = outline.min(axis=0), outline.max(axis=0)
    share = np.clip(((low + high) / 2 - start) @ way / max(float(way @ way), 1e-9), 0, 1)
    nearest = start + share * way
    return bool(np.linalg.norm(np.maximum(np.maximum(low - nearest, nearest - high), 0)) < CORRIDOR)


def _given_offsets(
    entries: Mapping[str, Offset | dict[str, Offset]], names: Iterable[str]
) -> tuple[dict[str, Array], dict[str, dict[str, Array]]]:
    """Offsets of poses.yaml: those for every pose, and those of one object."""
    common = {n: v for n, v in entries.items() if not isinstance(v, dict)}
    special = {n: v for n, v in entries.items() if isinstance(v, dict)}
    for name in special:
        if name not in names:
            raise unknown_name("object in offsets", name, names)
    return vectors(common), {n: vectors(v) for n, v in special.items()}
