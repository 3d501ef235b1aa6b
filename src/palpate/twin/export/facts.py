"""Facts about a model's bodies, independent of its format: read from a twin and from its export,
and compared."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from palpate.geometry.pose import Array
from palpate.mjcf.shapes import mesh_vertices

CLOSE = 1e-5
"""Relative: single precision of USD and of meshes, six digits of MuJoCo's own MJCF."""
WORLD = "world"
GROUND = np.array([10.0, 10.0, 0.01])
"""m: half the sizes of the box whose top stands in for a plane."""

_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """A geom: what it takes of the world, and how it rubs.

    Attributes:
        box: (2, 3) m, lowest and highest coordinates in the world.
        friction: its sliding coefficient; None where it touches nothing, or nobody says.
    """

    box: Array
    friction: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Facts:
    """A body.

    Attributes:
        pose: (4, 4) of its frame in the world.
        mass: kg.
        com: (3,) m, and inertia: (3, 3) kg m^2 about it, in the body's frame.
        shapes: in the order of the file.
    """

    pose: Array
    mass: float
    com: Array
    inertia: Array
    shapes: tuple[Shape, ...]


def facts_of(model: mujoco.MjModel, colliding: bool = False) -> dict[str, Facts]:
    """The bodies of a model where it starts, the world among them; with `colliding`, of their geoms
    only those that touch something."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    found: dict[str, Facts] = {}
    for i in range(model.nbody):
        found[model.body(i).name or unnamed(i)] = _facts(model, data, i, colliding)
    return found


def unnamed(body: int) -> str:
    """Name of a body without a name."""
    return f"body_{body}"


def _facts(model: mujoco.MjModel, data: mujoco.MjData, body: int, colliding: bool) -> Facts:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = data.xmat[body].reshape(3, 3), data.xpos[body]
    axes = np.empty(9)
    mujoco.mju_quat2Mat(axes, model.body_iquat[body])
    turned = axes.reshape(3, 3)
    inertia = turned @ np.diag(model.body_inertia[body]) @ turned.T
    shapes: list[Shape] = []
    first = int(model.body_geomadr[body])
    for geom in range(first, first + int(model.body_geomnum[body])):
        if touches(model, geom) or not colliding:
            shapes.append(_shape(model, data, geom))
    mass, com = float(model.body_mass[body]), model.body_ipos[body].copy()
    return Facts(pose, mass, com, inertia, tuple(shapes))


def touches(model: mujoco.MjModel, geom: int) -> bool:
    """True if a geom collides with anything."""
    return bool(model.geom_contype[geom] or model.geom_conaffinity[geom])


def _shape(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> Shape:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom]
    friction = float(model.geom_friction[geom, 0]) if touches(model, geom) else None
    return Shape(_box(model, geom, pose), friction)


def _box(model: mujoco.MjModel, geom: int, pose: Array) -> Array:
    kind, size = mujoco.mjtGeom(model.geom_type[geom]), model.geom_size[geom]
    if kind in (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_SDF):
        return around(pose, mesh_vertices(model, int(model.geom_dataid[geom])))
    if kind == mujoco.mjtGeom.mjGEOM_PLANE:
        return plane_box(pose)
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return round_box(pose, float(size[0]))
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return round_box(pose, float(size[0]), float(size[1]))
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return cylinder_box(pose, float(size[0]), float(size[1]))
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        return round_box(pose @ np.diag([*size, 1.0]), 1.0)
    return around(pose, _CORNERS * size)


def around(frame: Array, points: Array) -> Array:
    """(2, 3) the box around points (n, 3) of a frame (4, 4), which may be stretched."""
    there = points @ frame[:3, :3].T + frame[:3, 3]
    return np.array([there.min(axis=0), there.max(axis=0)])


def round_box(frame: Array, radius: float, half: float = 0.0) -> Array:
    """Box as `around`, of a ball, or of a capsule of that half length along z."""
    reach = half * np.abs(frame[:3, 2]) + radius * np.linalg.norm(frame[:3, :3], axis=1)
    return np.array([frame[:3, 3] - reach, frame[:3, 3] + reach])


def cylinder_box(frame: Array, radius: float, half: float) -> Array:
    """Box as `around`, of a cylinder along z."""
    reach = half * np.abs(frame[:3, 2]) + radius * np.linalg.norm(frame[:3, :2], axis=1)
    return np.array([frame[:3, 3] - reach, frame[:3, 3] + reach])


def plane_box(frame: Array) -> Array:
    """Box as `around`, of a plane, which is infinite: of the box that replaces it."""
    return around(frame, _CORNERS * GROUND - [0.0, 0.0, GROUND[2]])


def differences(
    twin: Mapping[str, Facts], made: Mapping[str, Facts], friction: bool = True
) -> Iterator[tuple[str, str]]:
    """Each body of the twin that was made into something else, and what of it; `friction` is
    whether the format has any."""
    for name, facts in twin.items():
        other = made.get(name)
        if other is None:
            yield name, "it is missing"
            continue
        for what, mine, its in _pairs(facts, other, friction):
            if mine.shape != its.shape or not np.allclose(its, mine, CLOSE, _least(mine)):
                yield name, _differing(what, mine, its)


def _pairs(one: Facts, other: Facts, friction: bool) -> Iterator[tuple[str, Array, Array]]:
    """Pairs of corresponding facts of a body."""
    yield "pose", one.pose, other.pose
    if one.mass > 0.0:
        yield "mass", np.array([one.mass]), np.array([other.mass])
        yield "com", one.com, other.com
        yield "inertia", one.inertia, other.inertia
    yield "shape", _boxes(one.shapes), _boxes(other.shapes)
    if friction:
        yield "friction", _frictions(one.shapes), _frictions(other.shapes)


def _least(values: Array) -> float:
    """The absolute difference that does not count, of numbers beside larger ones."""
    return max(CLOSE * float(np.abs(values).max(initial=0.0)), 1e-15)


def _boxes(shapes: Sequence[Shape]) -> Array:
    return np.array([shape.box for shape in shapes]).reshape(-1, 2, 3)


def _frictions(shapes: Sequence[Shape]) -> Array:
    return np.array([shape.friction for shape in shapes if shape.friction is not None])


def _differing(what: str, mine: Array, its: Array) -> str:
    """The first number that differs, with the digits that show it."""
    if mine.shape != its.shape:
        return f"its {what} has {its.size} numbers instead of {mine.size}"
    apart = int(np.argmax(np.abs(its - mine)))
    return f"its {what} has {its.flat[apart]:.8g} instead of {mine.flat[apart]:.8g}"
