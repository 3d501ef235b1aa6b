"""Visual geometry of a MuJoCo model in the page's 3-D view; only poses change later."""

# trimesh is typed in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Callable, Iterator

import mujoco
import numpy as np
from numpy.typing import NDArray
from trimesh import Trimesh, creation
from viser import FrameHandle, SceneApi

from palpate.geometry.pose import Array

SEEN_GROUPS = 3
"""Groups 0 to 2 are what MuJoCo's own viewer shows at first; collision shapes stand in the others."""

PLANE = 2.0
"""m: half the side of a plane without an end."""

Type = mujoco.mjtGeom


class Drawn:
    """The bodies of a model in the page's view.

    Args:
        view: where they are drawn.
        model: whose bodies.
    """

    def __init__(self, view: SceneApi, model: mujoco.MjModel) -> None:
        self._frames: dict[int, FrameHandle] = {}
        for geom in _seen(model):
            body = int(model.geom_bodyid[geom])
            if body not in self._frames:
                self._frames[body] = view.add_frame(f"/bodies/{body}", show_axes=False)
            _draw(view, model, geom, f"/bodies/{body}/{geom}")

    def move(self, data: mujoco.MjData) -> None:
        """Put every body where it is."""
        for body, frame in self._frames.items():
            frame.position = data.xpos[body]
            frame.wxyz = data.xquat[body]


def _seen(model: mujoco.MjModel) -> Iterator[int]:
    for geom in range(model.ngeom):
        colour = _colour(model, geom)
        if model.geom_group[geom] < SEEN_GROUPS and colour[3] > 0:
            yield geom


def _colour(model: mujoco.MjModel, geom: int) -> Array:
    """(4,) red, green, blue and opacity, 0 to 1."""
    material = int(model.geom_matid[geom])
    if material >= 0:
        return model.mat_rgba[material]
    return model.geom_rgba[geom]


def _draw(view: SceneApi, model: mujoco.MjModel, geom: int, name: str) -> None:
    surface = _surface(model, geom)
    if surface is None:
        return
    *colour, opacity = (float(value) for value in _colour(model, geom))
    red, green, blue = (round(255 * value) for value in colour)
    view.add_mesh_simple(
        name,
        *surface,
        color=(red, green, blue),
        opacity=None if opacity >= 1 else opacity,
        flat_shading=int(model.geom_type[geom]) == Type.mjGEOM_BOX,
        side="double",
        position=model.geom_pos[geom],
        wxyz=model.geom_quat[geom],
    )


Surface = tuple[NDArray[np.float32], NDArray[np.int32]]
"""Vertices (n, 3), m, and triangles (m, 3)."""


def _surface(model: mujoco.MjModel, geom: int) -> Surface | None:
    """A geom's surface in its own frame; None of what has none that can be drawn so (height fields)."""
    kind = Type(int(model.geom_type[geom]))
    if kind is Type.mjGEOM_MESH:
        return _mesh(model, int(model.geom_dataid[geom]))
    make = _SHAPES.get(kind)
    if make is None:
        return None
    x, y, z = (float(value) for value in model.geom_size[geom])
    made = make(x, y, z)
    return made.vertices.astype(np.float32), made.faces.astype(np.int32)


def _capsule(radius: float, half: float, _: float) -> Trimesh:
    made = creation.capsule(height=2 * half, radius=radius, count=[16, 16])
    made.apply_translation(-made.bounds.mean(axis=0))
    return made


def _ellipsoid(x: float, y: float, z: float) -> Trimesh:
    return creation.icosphere(subdivisions=3).apply_scale((x, y, z))


def _plane(x: float, y: float, _: float) -> Trimesh:
    return creation.box((2 * (x or PLANE), 2 * (y or PLANE), 1e-4))


_SHAPES: dict[Type, Callable[[float, float, float], Trimesh]] = {
    Type.mjGEOM_BOX: lambda x, y, z: creation.box((2 * x, 2 * y, 2 * z)),
    Type.mjGEOM_CYLINDER: lambda x, y, _: creation.cylinder(x, 2 * y, sections=48),
    Type.mjGEOM_SPHERE: lambda x, _, __: creation.icosphere(subdivisions=3, radius=x),
    Type.mjGEOM_ELLIPSOID: _ellipsoid,
    Type.mjGEOM_CAPSULE: _capsule,
    Type.mjGEOM_PLANE: _plane,
}


def _mesh(model: mujoco.MjModel, mesh: int) -> Surface:
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    face, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    return model.mesh_vert[first : first + count], model.mesh_face[face : face + faces]
