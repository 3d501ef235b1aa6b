"""Facts about a model's bodies, independent of its format: read from a twin and from its export, and
compared."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields

import mujoco
import numpy as np

from palpate.geometry.pose import Array
from palpate.mjcf.shapes import mesh_vertices

CLOSE = 1e-5
"""Relative: single precision of USD and of meshes, six digits of MuJoCo's own MJCF."""
WORLD = "world"
GROUND = np.array([10.0, 10.0, 0.01])
"""m: half extents of the box whose top stands in for a plane."""
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
"""(8, 3) of a cube with edges of 2."""


@dataclass(frozen=True, slots=True, eq=False)
class Facts:
    """A body, with its n shapes in the order of the file.

    Attributes:
        pose: (4, 4) of its frame in the world.
        mass: (1,) kg.
        com: (3,) m, and inertia: (3, 3) kg m^2 about it, in the body's frame.
        shape: (n, 2, 3) m, lowest and highest world coordinates of each.
        friction: (k,) sliding coefficients of those that collide and state one.
    """

    pose: Array
    mass: Array
    com: Array
    inertia: Array
    shape: Array
    friction: Array


def facts_of(model: mujoco.MjModel, colliding: bool = False) -> dict[str, Facts]:
    """The bodies of a model in its initial configuration, the world among them; with `colliding`, only
    the geoms that collide."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    found: dict[str, Facts] = {}
    for body in range(model.nbody):
        touching = [geom for geom in geoms_of(model, body) if collides(model, geom)]
        boxes: list[Array] = []
        for geom in touching if colliding else geoms_of(model, body):
            frame = homogeneous(data.geom_xmat[geom], data.geom_xpos[geom])
            boxes.append(box_of(model, geom, frame))
        found[body_name(model, body)] = Facts(
            homogeneous(data.xmat[body], data.xpos[body]),
            np.array([model.body_mass[body]]),
            model.body_ipos[body].copy(),
            tensor(model.body_inertia[body], model.body_iquat[body]),
            np.array(boxes).reshape(-1, 2, 3),
            np.array([float(model.geom_friction[geom, 0]) for geom in touching]),
        )
    return found


def body_name(model: mujoco.MjModel, body: int) -> str:
    """Name of a body, its link and its frame."""
    return model.body(body).name or unnamed(body)


def unnamed(body: int) -> str:
    """Name of a body without a name."""
    return f"body_{body}"


def geoms_of(model: mujoco.MjModel, body: int) -> range:
    """The geoms of a body."""
    first = int(model.body_geomadr[body])
    return range(first, first + int(model.body_geomnum[body]))


def collides(model: mujoco.MjModel, geom: int) -> bool:
    """Test if a geom collides with anything."""
    return bool(model.geom_contype[geom] or model.geom_conaffinity[geom])


def homogeneous(rotation: Array, position: Array) -> Array:
    """(4, 4) transformation of a rotation matrix, (9,) or (3, 3), and a position (3,)."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation.reshape(3, 3), position
    return pose


def tensor(principal: Array, quaternion: Array) -> Array:
    """(3, 3) inertia tensor R diag(I) R^T of principal moments (3,) and their axes' quaternion (4,)."""
    axes = np.empty(9)
    mujoco.mju_quat2Mat(axes, quaternion)
    rotation = axes.reshape(3, 3)
    return rotation @ np.diag(principal) @ rotation.T


def box_of(model: mujoco.MjModel, geom: int, frame: Array) -> Array:
    kind, size = mujoco.mjtGeom(model.geom_type[geom]), model.geom_size[geom]
    radius, half = float(size[0]), float(size[1])
    match kind:
        case mujoco.mjtGeom.mjGEOM_MESH | mujoco.mjtGeom.mjGEOM_SDF:
            return around(frame, mesh_vertices(model, int(model.geom_dataid[geom])))
        case mujoco.mjtGeom.mjGEOM_PLANE:
            return plane_box(frame)
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            return round_box(frame, radius)
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            return round_box(frame, radius, half)
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            return round_box(frame, radius, half, axes=2)
        case mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            return round_box(frame @ np.diag([*size, 1.0]), 1.0)
        case _:
            return around(frame, CORNERS * size)


def around(frame: Array, points: Array) -> Array:
    """(2, 3) box around points (n, 3) of a frame (4, 4), which may be stretched."""
    there = points @ frame[:3, :3].T + frame[:3, 3]
    return np.array([there.min(axis=0), there.max(axis=0)])


def round_box(frame: Array, radius: float, half: float = 0.0, axes: int = 3) -> Array:
    """(2, 3) box of a capsule of that half length along z, of a ball where that is 0, or, with two
    `axes`, of a cylinder; the frame may be stretched."""
    reach = half * np.abs(frame[:3, 2]) + radius * np.linalg.norm(frame[:3, :axes], axis=1)
    return np.array([frame[:3, 3] - reach, frame[:3, 3] + reach])


def plane_box(frame: Array) -> Array:
    """(2, 3) box around the box that stands in for an infinite plane."""
    return around(frame, CORNERS * GROUND - [0.0, 0.0, GROUND[2]])


def differences(
    twin: Mapping[str, Facts], made: Mapping[str, Facts], friction: bool = True
) -> Iterator[tuple[str, str]]:
    """Bodies of the twin that differ in what was made of it, each with a difference in words;
    `friction`: the format has any."""
    for name, facts in twin.items():
        other = made.get(name)
        if other is None:
            yield name, "it is missing"
            continue
        for what in (field.name for field in fields(Facts)):
            of_mass = what in ("mass", "com", "inertia")
            if (of_mass and not facts.mass[0] > 0.0) or (what == "friction" and not friction):
                continue
            mine, its = getattr(facts, what), getattr(other, what)
            if mine.shape != its.shape:
                yield name, f"its {what} has {its.size} numbers instead of {mine.size}"
                continue
            # A small number beside large ones has their absolute precision.
            least = max(CLOSE * float(np.abs(mine).max(initial=0.0)), 1e-15)
            if not np.allclose(its, mine, CLOSE, least):
                i = int(np.argmax(np.abs(its - mine)))
                yield name, f"its {what} has {its.flat[i]:.8g} instead of {mine.flat[i]:.8g}"
