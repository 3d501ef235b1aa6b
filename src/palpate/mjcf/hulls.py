"""Points whose convex hull is a geom, the edges between them, and volumes: corners of a box, two rings
of a cylinder, rings between the poles of a ball, extreme vertices of a mesh."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from palpate.geometry.pose import Array

INFINITE_PLANE = 10.0
"""m: half extent of an infinite plane."""

_CIRCLE = 48
"""Corners of a circle; a multiple of four, so that boxes around round shapes are exact."""

_LATITUDES, _LONGITUDES = 11, 24
"""Rings of a ball between its poles, and points on each; odd and a multiple of four for the same
reason."""


def hull_points(model: mujoco.MjModel, geom: int) -> Array:
    """(k, 3) points in the geom's frame whose convex hull is the geom, m; circles as polygons."""
    kind = int(model.geom_type[geom])
    size = np.array(model.geom_size[geom])
    if kind in (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_SDF):
        points = mesh_vertices(model, int(model.geom_dataid[geom]))
        if len(points) <= len(_directions()):
            return points
        # The extreme vertices in many directions have nearly the same hull as all of them.
        return points[np.unique(np.argmax(_directions() @ points.T, axis=1))]
    if kind == mujoco.mjtGeom.mjGEOM_HFIELD:
        x, y, top, below = model.hfield_size[model.geom_dataid[geom]]
        top *= max(elevations(model, int(model.geom_dataid[geom])), default=0.0)
        return _corners(np.array([x, y, (top + below) / 2])) + np.array([0, 0, (top - below) / 2])
    if kind not in _OUTLINES:
        return np.zeros((1, 3))
    return _OUTLINES[kind](size)


def elevations(model: mujoco.MjModel, hfield: int) -> Array:
    """(n,) elevations of a height field, relative to its height."""
    first = int(model.hfield_adr[hfield])
    count = int(model.hfield_nrow[hfield] * model.hfield_ncol[hfield])
    return np.asarray(model.hfield_data[first : first + count], dtype=float)


@cache
def hull_edges(kind: int, count: int) -> NDArray[np.intp]:
    """(m, 2) index pairs of the `count` points of `hull_points` for a kind of geom, which include all
    edges of the hull."""
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return _ring_edges(2, _CIRCLE)
    if kind in (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        return _ball_edges()
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        half = count // 2
        across = np.column_stack([np.arange(half), np.arange(half) + half])
        return np.concatenate([_ball_edges(), _ball_edges() + half, across])
    return np.column_stack(np.triu_indices(count, 1))


def _ring_edges(rings: int, corners: int) -> NDArray[np.intp]:
    """(m, 2) edges along and between `rings` polygons of consecutive points."""
    index = np.arange(rings * corners).reshape(rings, corners)
    along = np.column_stack([index.ravel(), np.roll(index, -1, axis=1).ravel()])
    return np.concatenate([along, np.column_stack([index[:-1].ravel(), index[1:].ravel()])])


def _ball_edges() -> NDArray[np.intp]:
    """(m, 2) edges of the points of `_directions`: rings from south to north, then the poles."""
    north = _LATITUDES * _LONGITUDES
    south = north + 1
    lowest, highest = np.arange(_LONGITUDES), np.arange(north - _LONGITUDES, north)
    return np.concatenate(
        [
            _ring_edges(_LATITUDES, _LONGITUDES),
            np.column_stack([lowest, np.full(_LONGITUDES, south)]),
            np.column_stack([highest, np.full(_LONGITUDES, north)]),
        ]
    )


def geom_volume(model: mujoco.MjModel, geom: int) -> float:
    """Volume of a geom, m³."""
    r, h, z = model.geom_size[geom].tolist()
    kind = int(model.geom_type[geom])
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        # Divergence theorem: signed tetrahedra a · (b × c) / 6 from the origin to each triangle.
        a, b, c = np.moveaxis(mesh_corners(model, int(model.geom_dataid[geom])), 1, 0)
        return abs(float(np.einsum("ij,ij->", a, np.cross(b, c)))) / 6
    return {
        int(mujoco.mjtGeom.mjGEOM_BOX): 8 * r * h * z,
        int(mujoco.mjtGeom.mjGEOM_SPHERE): 4 / 3 * np.pi * r**3,
        int(mujoco.mjtGeom.mjGEOM_CYLINDER): 2 * np.pi * r**2 * h,
        int(mujoco.mjtGeom.mjGEOM_CAPSULE): 2 * np.pi * r**2 * h + 4 / 3 * np.pi * r**3,
        int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): 4 / 3 * np.pi * r * h * z,
    }.get(kind, 0.0)


def mesh_vertices(model: mujoco.MjModel, mesh: int) -> Array:
    """(n, 3) vertices of a mesh, m, in the frame of its geoms."""
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    return np.asarray(model.mesh_vert[first : first + count], dtype=float)


def mesh_corners(model: mujoco.MjModel, mesh: int) -> Array:
    """(m, 3, 3) corners of the triangles of a mesh, as `mesh_vertices`."""
    first, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    return mesh_vertices(model, mesh)[model.mesh_face[first : first + count]]


def _corners(half: Array) -> Array:
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).T.reshape(-1, 3)
    return signs * half


def _plane(size: Array) -> Array:
    return _corners(np.where(size > 0, size, INFINITE_PLANE) * np.array([1, 1, 0]))


def _cylinder(size: Array) -> Array:
    angle = np.arange(_CIRCLE) * 2 * np.pi / _CIRCLE
    ring = np.column_stack([np.cos(angle), np.sin(angle)]) * size[0]
    bottom = np.column_stack([ring, np.full(_CIRCLE, -size[1])])
    top = np.column_stack([ring, np.full(_CIRCLE, size[1])])
    return np.concatenate([bottom, top])


@cache
def _directions() -> Array:
    """(m, 3) unit vectors over the sphere, symmetric about every axis plane."""
    latitude = (np.arange(_LATITUDES) + 1)[:, None] * np.pi / (_LATITUDES + 1) - np.pi / 2
    longitude = np.arange(_LONGITUDES) * 2 * np.pi / _LONGITUDES
    grid = np.stack(
        np.broadcast_arrays(
            np.cos(latitude) * np.cos(longitude),
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude),
        ),
        axis=-1,
    )
    return np.concatenate([grid.reshape(-1, 3), [[0, 0, 1], [0, 0, -1]]])


def _capsule(size: Array) -> Array:
    ball = _directions() * size[0]
    up = np.array([0, 0, size[1]])
    return np.concatenate([ball + up, ball - up])


_OUTLINES: dict[int, Callable[[Array], Array]] = {
    int(mujoco.mjtGeom.mjGEOM_PLANE): _plane,
    int(mujoco.mjtGeom.mjGEOM_BOX): _corners,
    int(mujoco.mjtGeom.mjGEOM_SPHERE): lambda size: _directions() * size[0],
    int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): lambda size: _directions() * size,
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): _cylinder,
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): _capsule,
}
