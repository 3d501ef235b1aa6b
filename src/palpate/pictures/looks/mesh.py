"""Small meshes made by arithmetic: turned, bent, folded. No files: a few hundred vertices each, made
when a picture is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.geometry.pose import Array

Faces = NDArray[np.int32]
SEGMENTS = 40
"""Of a full turn."""


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles, seen from outside counter-clockwise.

    Attributes:
        vertices: (n, 3) m.
        faces: (m, 3) rows of `vertices`.
        uv: (n, 2) where in a print each vertex lies: from its left to its right, and from its foot
            to its head, 0 to 1.
    """

    vertices: Array
    faces: Faces
    uv: Array

    def moved(self, by: Sequence[float] | Array) -> Mesh:
        """The mesh somewhere else, m."""
        return Mesh(self.vertices + np.asarray(by), self.faces, self.uv)


def joined(meshes: Sequence[Mesh]) -> Mesh:
    """Several meshes as one."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate(faces).astype(np.int32),
        np.concatenate([mesh.uv for mesh in meshes]),
    )


def lathe(profile: Sequence[tuple[float, float]], segments: int = SEGMENTS) -> Mesh:
    """Surface of revolution about z: `profile` holds (radius, z) in m, upwards along the outside. A
    print goes once around."""
    outline = np.array(profile, dtype=float)
    turn = np.linspace(0.0, 2 * np.pi, segments + 1)
    radius, z = outline[:, :1], outline[:, 1:]
    x, y = radius * np.cos(turn), radius * np.sin(turn)
    points = np.stack([x, y, np.broadcast_to(z, x.shape)], axis=-1)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(outline, axis=0), axis=1))])
    return _sheet(points, turn / (2 * np.pi), way / way[-1])


def tube(
    path: Array, radii: Sequence[float] | Array, flat: float = 1.0, segments: int = 20
) -> Mesh:
    """A closed rod along `path` (n, 3), as thick as `radii` say (n,), m; across the level it is
    `flat` times as thick."""
    centres = np.asarray(path, dtype=float)
    along = np.gradient(centres, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = np.cross(along, [0.0, 0.0, 1.0])
    level = np.linalg.norm(side, axis=1, keepdims=True) < 1e-6
    side = np.where(level, [1.0, 0.0, 0.0], side)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(side, along)
    turn = np.linspace(0.0, 2 * np.pi, segments + 1)[None, :, None]
    ring = np.cos(turn) * side[:, None] + flat * np.sin(turn) * up[:, None]
    points = centres[:, None] + np.asarray(radii, dtype=float)[:, None, None] * ring
    # Ends are closed by a ring without width.
    points = np.concatenate([_point(points[0]), points, _point(points[-1])])
    return _sheet(points, np.linspace(0, 1, segments + 1), np.linspace(0, 1, len(points)))


def _point(ring: Array) -> Array:
    """(1, n, 3): a ring drawn together in its middle."""
    return np.broadcast_to(ring[:-1].mean(axis=0), ring.shape)[None]


def _sheet(points: Array, u: Array, v: Array) -> Mesh:
    """A grid of points (rows, columns, 3), with where its columns and rows lie in a print."""
    rows, columns = points.shape[:2]
    index: Faces = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    low, right = index[:-1, :-1].ravel(), index[:-1, 1:].ravel()
    top, far = index[1:, :-1].ravel(), index[1:, 1:].ravel()
    faces = np.concatenate([np.stack([low, right, far], 1), np.stack([low, far, top], 1)])
    uv = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    return _without_slivers(Mesh(points.reshape(-1, 3), faces.astype(np.int32), uv))


def _without_slivers(mesh: Mesh) -> Mesh:
    """Triangles without area, at poles and ends, are left out."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return Mesh(mesh.vertices, mesh.faces[area > 1e-12], mesh.uv)


def panel(corners: Array, uv: tuple[float, float, float, float] = (0, 0, 1, 1)) -> Mesh:
    """A flat four-sided sheet: `corners` (4, 3) counter-clockwise from the foot's left, `uv` left,
    foot, right, head in a print."""
    left, foot, right, head = uv
    where = np.array([[left, foot], [right, foot], [right, head], [left, head]])
    return Mesh(np.asarray(corners, dtype=float), np.array([[0, 1, 2], [0, 2, 3]], np.int32), where)


FRONT, SIDE, LID = (0.0, 0.0, 0.5, 0.8), (0.5, 0.0, 1.0, 0.8), (0.0, 0.8, 1.0, 1.0)
"""Regions of a box's print: front and back, other sides, top and bottom."""
_WHOLE = (0.0, 0.0, 1.0, 1.0)


def cuboid(half: Sequence[float] | Array, whole: bool = True) -> Mesh:
    """A box of half extents `half`, m. A print is on each side `whole`, else by `FRONT`, `SIDE`,
    `LID`; the front is the wider side."""
    x, y, z = half
    front, side, lid = (_WHOLE, _WHOLE, _WHOLE) if whole else (FRONT, SIDE, LID)
    if y > x:
        front, side = side, front
    sides = [
        (np.array([[-x, -y, -z], [x, -y, -z], [x, -y, z], [-x, -y, z]]), front),
        (np.array([[x, y, -z], [-x, y, -z], [-x, y, z], [x, y, z]]), front),
        (np.array([[x, -y, -z], [x, y, -z], [x, y, z], [x, -y, z]]), side),
        (np.array([[-x, y, -z], [-x, -y, -z], [-x, -y, z], [-x, y, z]]), side),
        (np.array([[-x, -y, z], [x, -y, z], [x, y, z], [-x, y, z]]), lid),
        (np.array([[-x, y, -z], [x, y, -z], [x, -y, -z], [-x, -y, -z]]), lid),
    ]
    return joined([panel(corners, uv) for corners, uv in sides])


def pillow(half: Sequence[float] | Array, roundness: float, segments: int = 32) -> Mesh:
    """A superellipsoid of half extents `half`, m: 1 is an ellipsoid, towards 0 a box with rounded
    edges. A print lies on it from above."""
    turn = np.linspace(-np.pi, np.pi, segments + 1)[None]
    rise = np.linspace(-np.pi / 2, np.pi / 2, segments // 2 + 1)[:, None]
    x = _bent(np.cos(rise), roundness) * _bent(np.cos(turn), roundness)
    y = _bent(np.cos(rise), roundness) * _bent(np.sin(turn), roundness)
    z = np.broadcast_to(_bent(np.sin(rise), roundness), x.shape)
    points = np.stack([x, y, z], axis=-1) * np.asarray(half)
    mesh = _sheet(points, turn[0], rise[:, 0])
    above = np.stack([(x.ravel() + 1) / 2, (y.ravel() + 1) / 2], axis=1)
    return Mesh(mesh.vertices, mesh.faces, above)


def _bent(values: Array, power: float) -> Array:
    return np.sign(values) * np.abs(values) ** power


def grid(x: Array, y: Array, height: Array) -> Mesh:
    """A sheet over the level: `height` (ny, nx) m above places `x` (nx,), `y` (ny,)."""
    across, along = np.meshgrid(x, y)
    points = np.stack([across, along, height], axis=-1)
    return _sheet(points, np.linspace(0, 1, len(x)), np.linspace(0, 1, len(y)))
