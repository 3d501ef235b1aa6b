"""Visual geometry of a MuJoCo model in the page's 3-D view; only poses change later."""

# trimesh is typed in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray
from trimesh import creation
from viser import FrameHandle, SceneApi

from palpate.pictures.renderer import geom_rgba

SEEN_GROUPS = 3
"""Groups 0 to 2 are shown by MuJoCo's own viewer at first; collision shapes are in the others."""
PLANE = 2.0
"""Half the side of an infinite plane, m."""

Type = mujoco.mjtGeom
Surface = tuple[NDArray[np.float32], NDArray[np.int32]]
"""Vertices (n, 3), m, and triangles (m, 3)."""


class Drawn:
    """The bodies of a model in the page's view."""

    def __init__(self, view: SceneApi, model: mujoco.MjModel) -> None:
        self._frames: dict[int, FrameHandle] = {}
        for geom in range(model.ngeom):
            *colour, opacity = (float(value) for value in geom_rgba(model, geom))
            if model.geom_group[geom] >= SEEN_GROUPS or opacity <= 0:
                continue
            body = int(model.geom_bodyid[geom])
            if body not in self._frames:
                self._frames[body] = view.add_frame(f"/bodies/{body}", show_axes=False)
            surface = _surface(model, geom)
            if surface is None:
                continue
            red, green, blue = (round(255 * value) for value in colour)
            view.add_mesh_simple(
                f"/bodies/{body}/{geom}",
                *surface,
                color=(red, green, blue),
                opacity=None if opacity >= 1 else opacity,
                flat_shading=int(model.geom_type[geom]) == Type.mjGEOM_BOX,
                side="double",
                position=model.geom_pos[geom],
                wxyz=model.geom_quat[geom],
            )

    def move(self, data: mujoco.MjData) -> None:
        """Move every body to its pose."""
        for body, frame in self._frames.items():
            frame.position = data.xpos[body]
            frame.wxyz = data.xquat[body]


def _surface(model: mujoco.MjModel, geom: int) -> Surface | None:
    """A geom's surface in its own frame; None for height fields and signed distance fields."""
    x, y, z = (float(value) for value in model.geom_size[geom])
    match Type(int(model.geom_type[geom])):
        case Type.mjGEOM_MESH:
            mesh = int(model.geom_dataid[geom])
            first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
            face, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
            return model.mesh_vert[first : first + count], model.mesh_face[face : face + faces]
        case Type.mjGEOM_BOX:
            made = creation.box((2 * x, 2 * y, 2 * z))
        case Type.mjGEOM_CYLINDER:
            made = creation.cylinder(x, 2 * y, sections=48)
        case Type.mjGEOM_SPHERE:
            made = creation.icosphere(subdivisions=3, radius=x)
        case Type.mjGEOM_ELLIPSOID:
            made = creation.icosphere(subdivisions=3).apply_scale((x, y, z))
        case Type.mjGEOM_CAPSULE:
            made = creation.capsule(height=2 * y, radius=x, count=[16, 16])
            made.apply_translation(-made.bounds.mean(axis=0))
        case Type.mjGEOM_PLANE:
            made = creation.box((2 * (x or PLANE), 2 * (y or PLANE), 1e-4))
        case _:
            return None
    return made.vertices.astype(np.float32), made.faces.astype(np.int32)
