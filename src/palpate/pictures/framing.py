"""Camera pose that frames the work."""

from __future__ import annotations

from collections.abc import Collection, Iterable

import mujoco
import numpy as np

from palpate.geometry.pose import Array

AZIMUTH, ELEVATION = 145.0, -22.0
"""degrees, MuJoCo's free camera: from in front of the arm, over its left shoulder's side, a little
from above."""
EMPTY_EXTENT = np.array([[-0.5, -0.5, 0.0], [0.5, 0.5, 0.8]])
"""m: what is looked at where there is nothing to see: about a table top."""


def extent(model: mujoco.MjModel, data: mujoco.MjData, bodies: Collection[str] = ()) -> Array:
    """World corners (n, 3) in m of the boxes around the geoms of the named bodies (all, when none
    is named).

    Planes have no end and are left out.
    """
    corners: list[Array] = []
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
    for geom in range(model.ngeom):
        is_plane = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE
        if is_plane or not _belongs(model, geom, bodies):
            continue
        local = model.geom_aabb[geom, :3] + signs * model.geom_aabb[geom, 3:]
        corners.append(data.geom_xpos[geom] + local @ data.geom_xmat[geom].reshape(3, 3).T)
    if not corners:
        return EMPTY_EXTENT
    return np.concatenate(corners)


def _belongs(model: mujoco.MjModel, geom: int, bodies: Collection[str]) -> bool:
    body = int(model.geom_bodyid[geom])
    while bodies and body:
        if model.body(body).name in bodies:
            return True
        body = int(model.body_parentid[body])
    return not bodies


def framing(
    points: Array,
    *,
    aspect: float,
    fovy: float = 40.0,
    azimuth: float = AZIMUTH,
    elevation: float = ELEVATION,
    margin: float = 1.08,
) -> mujoco.MjvCamera:
    """The nearest free camera of that direction that has all `points` (n, 3) in view.

    `fovy` (degrees) must be the model's `vis.global_.fovy`; `aspect` is width over height.
    """
    az, el = np.radians([azimuth, elevation])
    forward = np.array([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)])
    right = np.array([np.sin(az), -np.cos(az), 0.0])
    up = np.cross(right, forward)
    lookat = (points.min(0) + points.max(0)) / 2
    offset = points - lookat
    # centre what is seen, not the box: perspective makes near corners larger
    lookat = lookat + up * _middle(offset @ up) + right * _middle(offset @ right)
    offset = points - lookat
    tangent = np.tan(np.radians(fovy) / 2)
    needed = (
        np.maximum(abs(offset @ up) / tangent, abs(offset @ right) / (tangent * aspect)) * margin
    )
    camera = mujoco.MjvCamera()
    camera.lookat[:] = lookat
    camera.distance = float(np.max(needed - offset @ forward))
    camera.azimuth, camera.elevation = azimuth, elevation
    return camera


def _middle(values: Array) -> float:
    return float((values.min() + values.max()) / 2)


def points_over(
    model: mujoco.MjModel, poses: Iterable[Array], bodies: Collection[str] = ()
) -> Array:
    """`extent` over several configurations `qpos` (nq,), for a camera that stays."""
    data = mujoco.MjData(model)
    corners: list[Array] = []
    for qpos in poses:
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        corners.append(extent(model, data, bodies))
    if not corners:
        return extent(model, data, bodies)
    return np.concatenate(corners)
