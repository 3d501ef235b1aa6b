"""Symbols that the scene's geometry implies, completed and overruled by `poses.yaml`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from palpate.errors import InputError
from palpate.pose import Array, Pose
from palpate.scene.grasp import HAND, PAD, Grasp, above, derive_grasp
from palpate.scene.outline import rectangle, rim
from palpate.scene.places import approach_pose, free_spot
from palpate.scene.priors import APPROACH, RESTING
from palpate.scene.scene import Body
from palpate.scene.source import Belief
from palpate.scene.symbols import DEFAULT_OFFSETS, HOME, Symbols, vectors

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
    """Points of every colliding geom in the world, by object, by surface and for the rest."""

    objects: Mapping[str, list[Array]]
    tops: Mapping[str, Array]
    statics: Mapping[int, Array]
    bodies: Mapping[str, Body]
    base: Pose
    carriers: Mapping[str, int]

    @classmethod
    def of(cls, belief: Belief, bodies: Mapping[str, Body], base: Pose) -> Geometry:
        """From the compiled scene."""
        shapes, found = belief.shapes, belief.source.found
        objects = {n: [shapes.points(g) for g in found.objects[n].colliding] for n in found.objects}
        movable = {shapes.geom_ids[g] for thing in found.objects.values() for g in thing.geoms}
        model = shapes.model
        statics = {i: shapes.geom_points(i) for i in range(model.ngeom)
                   if i not in movable and (model.geom_contype[i] or model.geom_conaffinity[i])
                   and model.geom_type[i] != mujoco.mjtGeom.mjGEOM_PLANE}
        carriers = {n: shapes.geom_ids[belief.source.filler.carrier(s)] for n, s in found.surfaces.items()}
        tops = {n: shapes.geom_points(i) for n, i in carriers.items()}
        return cls(objects, tops, statics, bodies, base, carriers)

    def others(self, *names: str) -> list[Array]:
        """Shapes of everything but the named objects and surfaces."""
        own = {self.carriers[n] for n in names if n in self.carriers}
        things = [points for n, geoms in self.objects.items() if n not in names for points in geoms]
        return [*things, *(points for i, points in self.statics.items() if i not in own)]

    def on(self, surface: str) -> list[Array]:
        """The objects that stand on a surface."""
        top = self.bodies[surface]
        clouds = (np.concatenate(geoms) for geoms in self.objects.values())
        return [c for c in clouds if abs(c[:, 2].min() - top.top_z()) < RESTING and top.covers(*_middle(c))]

    def support(self, name: str) -> str | None:
        """The surface below an object."""
        cloud = np.concatenate(self.objects[name])
        under = [b for b in self.bodies.values() if b.role == "surface" and b.covers(*_middle(cloud))
                 and b.top_z() < cloud[:, 2].min() + RESTING]
        return max(under, key=lambda b: b.top_z()).name if under else None


def _middle(cloud: Array) -> tuple[float, float]:
    x, y = (cloud.max(axis=0) + cloud.min(axis=0))[:2] / 2
    return float(x), float(y)


def derive_symbols(belief: Belief, bodies: Mapping[str, Body], base: Pose) -> Symbols:
    """All names of the scene: those of poses.yaml, and what geometry implies for the rest."""
    geometry = Geometry.of(belief, bodies, base)
    entries = belief.source.poses
    grasps = {name: _grasp(geometry, name) for name in geometry.objects}
    ungraspable = {n: g.problem for n, g in grasps.items() if g.problem and n not in entries.grasps}
    for name in geometry.objects:
        if "position" in bodies[name].missing and name not in entries.objects:
            ungraspable[name] = "nobody knows where it is; give its pose in poses.yaml"
    poses = {f"{n}_pose": g.pose for n, g in grasps.items()}
    poses |= {f"{n}_pose": bodies[n].pose_world @ e.tool_pose() for n, e in entries.grasps.items()}
    poses |= {f"{n}_approach": p for n in geometry.tops if (p := _approach(geometry, n)) is not None}
    poses |= {n: e.tool_pose() for n, e in entries.places.items()}
    subjects = {f"{n}_{suffix}": n for n in geometry.objects for suffix in ("pose", "temporary")}
    subjects |= {f"{n}_approach": n for n in geometry.tops}
    own = {n: _own_offsets(geometry, n, g, poses[f"{n}_pose"]) for n, g in grasps.items()}
    common, special = _given_offsets(entries.offsets, bodies)
    configurations = {"home_config": np.array(HOME)} | {n: np.array(q) for n, q in entries.joints.items()}
    later = {f"{n}_temporary": _later(geometry, n, poses[f"{n}_pose"]) for n in geometry.objects
             if f"{n}_temporary" not in poses}
    return Symbols(
        poses=poses, subjects={n: s for n, s in subjects.items() if n in poses or n in later},
        configurations=configurations,
        offsets={n: np.array(v) for n, v in DEFAULT_OFFSETS.items()} | common,
        own_offsets={n: own.get(n, {}) | common | special.get(n, {}) for n in own},
        ungraspable=ungraspable, later=later)


def free_place(geometry: Geometry, name: str, pose_world_tcp: Pose, avoiding: Iterable[str] = ()) -> Pose | None:
    """TCP pose at which the object, held as at `pose_world_tcp`, stands on a free spot of its surface.

    `avoiding` are objects that are to be reached meanwhile: the spot is looked for on the far side of them.
    """
    support = geometry.support(name)
    if support is None:
        return None
    cloud = np.concatenate(geometry.objects[name])
    here = np.array(_middle(cloud))
    hand = rectangle(pose_world_tcp.position[:2], pose_world_tcp.rotation[:2, 0], HAND[0], HAND[1] / 2)
    shape = rim(np.concatenate([cloud[:, :2], hand])) - here
    footing = np.array([cloud.min(axis=0)[:2], cloud.max(axis=0)[:2]]) - here
    bottom = float(cloud[:, 2].min())
    obstacles = above([*geometry.others(name, support), cloud], bottom + 0.002)
    obstacles += [_room(geometry, other) for other in avoiding]
    found = free_spot(shape, footing, geometry.tops[support], obstacles, here, bottom, geometry.base)
    return None if found is None else pose_world_tcp.translated((*(found[0] - here), 0.0))


def _room(geometry: Geometry, name: str) -> Array:
    """What the hand needs around an object to grasp it."""
    middle = np.array(_middle(np.concatenate(geometry.objects[name])))
    return rectangle(middle, np.array([1.0, 0.0]), HAND[1], HAND[1])


def _later(geometry: Geometry, name: str, pose: Pose) -> Callable[[], Pose | None]:
    return lambda: free_place(geometry, name, pose)


def _grasp(geometry: Geometry, name: str) -> Grasp:
    """The grasp among the neighbours, else the one there is once other objects are carried away."""
    rotation = geometry.bodies[name].pose_world.rotation
    level = int(np.argmax(np.hypot(rotation[0], rotation[1])))
    yaw = float(np.arctan2(rotation[1, level], rotation[0, level]))
    support = geometry.support(name)
    names = (name,) if support is None else (name, support)
    found = derive_grasp(geometry.objects[name], geometry.others(*names), yaw, geometry.base)
    if not found.problem:
        return found
    cleared = geometry.others(*names, *geometry.objects)
    return derive_grasp(geometry.objects[name], cleared, yaw, geometry.base)


def _approach(geometry: Geometry, name: str) -> Pose | None:
    return approach_pose(geometry.tops[name], geometry.others(name), geometry.on(name), APPROACH, geometry.base)


def _own_offsets(geometry: Geometry, name: str, grasp: Grasp, pose: Pose) -> dict[str, Array]:
    """Along x half of what the grasp may shift; along y a quarter of the width; along z a clear lift."""
    x = max((grasp.slack - PAD) / 2, 0.005)
    y = max(grasp.width / 4, 0.005)
    return {"x_offset": np.array([x, 0, 0]), "y_offset": np.array([0, y, 0]),
            "z_offset": np.array([0, 0, _lift(geometry, name, pose)])}


def _lift(geometry: Geometry, name: str, pose: Pose) -> float:
    bottom = float(np.concatenate(geometry.objects[name])[:, 2].min())
    tops = [float(c[:, 2].max()) for c in geometry.others(name) if _on_the_way(c, pose, geometry.base)]
    needed = max((top + CLEAR - bottom for top in tops), default=0.0)
    return float(np.clip(max(needed, USUAL_LIFT), *LIFT))


def _on_the_way(cloud: Array, pose: Pose, base: Pose) -> bool:
    """Whether something is near the straight way from above the arm's front to the object."""
    start = base.position[:2] + 0.3 * base.rotation[:2, 0]
    way = pose.position[:2] - start
    share = np.clip((np.array(_middle(cloud)) - start) @ way / max(float(way @ way), 1e-9), 0, 1)
    nearest = start + share * way
    low, high = cloud.min(axis=0)[:2], cloud.max(axis=0)[:2]
    return bool(np.linalg.norm(np.maximum(np.maximum(low - nearest, nearest - high), 0)) < CORRIDOR)


def _given_offsets(entries: Mapping[str, object],
                   bodies: Mapping[str, Body]) -> tuple[dict[str, Array], dict[str, dict[str, Array]]]:
    common = vectors({n: v for n, v in entries.items() if not isinstance(v, dict)})
    special: dict[str, dict[str, Array]] = {}
    for name, own in entries.items():
        if isinstance(own, dict):
            if name not in bodies:
                raise InputError(f"offsets of '{name}': no such object; valid: {', '.join(bodies)}")
            special[name] = vectors(own)
    return common, special

