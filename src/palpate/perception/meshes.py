"""Procedural triangle meshes with a few hundred vertices each, and the parts of a look."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array
from palpate.perception.renderer import Pixels

Faces = NDArray[np.int32]
Profile = Sequence[tuple[float, float]]
"""Outline of a surface of revolution: (radius, z), upwards on the outside."""
Colour = tuple[float, float, float]
"""Red, green and blue, 0 to 1."""

WHITE: Colour = (1.0, 1.0, 1.0)
STEEL: Colour = (0.62, 0.64, 0.67)

FRONT, SIDE, LID = (0.0, 0.0, 0.5, 0.8), (0.5, 0.0, 1.0, 0.8), (0.0, 0.8, 1.0, 1.0)
"""Texture regions of a box for `quad`: front and back, other sides, top and bottom."""
WHOLE = (0.0, 0.0, 1.0, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles, counter-clockwise seen from outside.

    Attributes:
        vertices: (n, 3) m.
        faces: (m, 3) rows of `vertices`.
        uv: (n, 2) texture coordinates, 0 to 1, left to right and bottom to top.
    """

    vertices: Array
    faces: Faces
    uv: Array

    def moved(self, by: Sequence[float] | Array) -> Mesh:
        """Return the mesh translated by (3,) m."""
        return Mesh(self.vertices + np.asarray(by), self.faces, self.uv)


@dataclass(frozen=True, slots=True, eq=False)
class LookPart:
    """Surface of one material, relative to the centre of the body's shapes.

    Attributes:
        mesh: the surface.
        colour: colour, multiplied by that of the texture.
        print: texture.
        shine: 0 dull to 1 glossy.
        see_through: 0 opaque to 1 clear.
    """

    mesh: Mesh
    colour: Colour
    print: Pixels | None = None
    shine: float = 0.15
    see_through: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class LookBox:
    """Box for a look around a body's shapes, in the body frame.

    Attributes:
        centre: (3,) m.
        half: (3,) half extents, m.
        colour: colour of the largest shape.
        drop: distance from the lower face of the box to the floor, m.
    """

    centre: Array
    half: Array
    colour: Colour
    drop: float = 0.0

    @property
    def radius(self) -> float:
        """Radius of the largest upright cylinder in the box, m."""
        return float(min(self.half[0], self.half[1]))

    @property
    def ink(self) -> tuple[int, int, int]:
        """The colour, 0 to 255."""
        red, green, blue = (round(255 * value) for value in self.colour)
        return red, green, blue


def join_meshes(meshes: Sequence[Mesh]) -> Mesh:
    """Join several meshes into one."""
    # Offset the faces by the number of vertices before them.
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate(faces).astype(np.int32),
        np.concatenate([mesh.uv for mesh in meshes]),
    )


def surface(points: Array, u: Array, v: Array) -> Mesh:
    """Surface through a grid of points (rows, columns, 3).

    `u` (columns,) and `v` (rows,) are its texture coordinates.
    """
    rows, columns = points.shape[:2]
    # Two triangles for each cell of the grid.
    index: Faces = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    low, right = index[:-1, :-1].ravel(), index[:-1, 1:].ravel()
    top, far = index[1:, :-1].ravel(), index[1:, 1:].ravel()
    faces = np.concatenate([np.stack([low, right, far], 1), np.stack([low, far, top], 1)])
    vertices = points.reshape(-1, 3)
    # Remove triangles without area at poles and closed ends, which MuJoCo rejects.
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    uv = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    return Mesh(vertices, faces.astype(np.int32)[area > 1e-12], uv)


def lathe(profile: Profile) -> Mesh:
    """Surface of revolution of a profile (m) about z; a texture covers one turn."""
    outline = np.array(profile, dtype=float)
    # Rotate the profile in 40 steps.
    turn = np.linspace(0.0, 2 * np.pi, 41)
    radius, z = outline[:, :1], outline[:, 1:]
    x, y = radius * np.cos(turn), radius * np.sin(turn)
    points = np.stack([x, y, np.broadcast_to(z, x.shape)], axis=-1)
    # The texture row follows the arc length of the outline, so that a texture is not stretched.
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(outline, axis=0), axis=1))])
    return surface(points, turn / (2 * np.pi), way / way[-1])


def revolve(fit: LookBox, profile: Profile, width: float = 1.0) -> Mesh:
    """Surface of revolution in a box.

    The profile is in units of `width` times the radius and of the half height of the box.
    """
    return lathe([(width * fit.radius * r, fit.half[2] * z) for r, z in profile])


def tube(path: Array, radii: Sequence[float] | Array, flat: float = 1.0) -> Mesh:
    """Closed rod along `path` (n, 3), m, with `radii` (n,), m.

    Its vertical thickness is `flat` times the horizontal one.
    """
    centres = np.asarray(path, dtype=float)
    # Unit tangents of the path.
    along = np.gradient(centres, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    # Horizontal and upward normals; a vertical path uses x as its horizontal normal.
    side = np.cross(along, [0.0, 0.0, 1.0])
    vertical = np.linalg.norm(side, axis=1, keepdims=True) < 1e-6
    side = np.where(vertical, [1.0, 0.0, 0.0], side)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(side, along)
    # Elliptical cross sections in 20 steps.
    turn = np.linspace(0.0, 2 * np.pi, 21)
    angle = turn[None, :, None]
    ring = np.cos(angle) * side[:, None] + flat * np.sin(angle) * up[:, None]
    points = centres[:, None] + np.asarray(radii, dtype=float)[:, None, None] * ring
    # Close each end by a ring of radius 0.
    first, last = (
        np.broadcast_to(end[:-1].mean(axis=0), end.shape)[None] for end in (points[0], points[-1])
    )
    points = np.concatenate([first, points, last])
    return surface(points, np.linspace(0, 1, 21), np.linspace(0, 1, len(points)))


def quad(corners: Sequence[Sequence[float]] | Array, uv: Sequence[float] = WHOLE) -> Mesh:
    """Flat sheet of four corners (4, 3), counter-clockwise from the lower left.

    `uv` is the texture region: left, bottom, right and top.
    """
    left, bottom, right, top = uv
    places = np.array([[left, bottom], [right, bottom], [right, top], [left, top]], dtype=float)
    return Mesh(np.array(corners, dtype=float), np.array([[0, 1, 2], [0, 2, 3]], np.int32), places)


def level_quad(x: float, y: float, z: float) -> Mesh:
    """Horizontal sheet of half extents `x` and `y` at height `z`, m, visible from above."""
    return quad([[-x, -y, z], [x, -y, z], [x, y, z], [-x, y, z]])


def cuboid(half: Sequence[float] | Array, whole: bool = True) -> Mesh:
    """Box of half extents (3,), m.

    A `whole` texture covers each side. Otherwise it has the regions `FRONT`, `SIDE` and `LID`; the
    front is the wider side.
    """
    x, y, z = half
    front, side, lid = (WHOLE, WHOLE, WHOLE) if whole else (FRONT, SIDE, LID)
    if y > x:
        front, side = side, front
    return join_meshes(
        [
            quad([[-x, -y, -z], [x, -y, -z], [x, -y, z], [-x, -y, z]], front),
            quad([[x, y, -z], [-x, y, -z], [-x, y, z], [x, y, z]], front),
            quad([[x, -y, -z], [x, y, -z], [x, y, z], [x, -y, z]], side),
            quad([[-x, y, -z], [-x, -y, -z], [-x, -y, z], [-x, y, z]], side),
            quad([[-x, -y, z], [x, -y, z], [x, y, z], [-x, y, z]], lid),
            quad([[-x, y, -z], [x, y, -z], [x, -y, -z], [-x, -y, -z]], lid),
        ]
    )


def superellipsoid(half: Sequence[float] | Array, roundness: float) -> Mesh:
    """Superellipsoid of half extents (3,), m.

    With roundness 1 it is an ellipsoid, towards 0 a box with rounded edges. A texture is projected
    from above.
    """

    def power(values: Array) -> Array:
        return np.sign(values) * np.abs(values) ** roundness

    # Parametric form: sign(c) |c|^roundness of the cosines and sines of longitude and latitude.
    turn = np.linspace(-np.pi, np.pi, 33)[None]
    rise = np.linspace(-np.pi / 2, np.pi / 2, 17)[:, None]
    x = power(np.cos(rise)) * power(np.cos(turn))
    y = power(np.cos(rise)) * power(np.sin(turn))
    z = np.broadcast_to(power(np.sin(rise)), x.shape)
    mesh = surface(np.stack([x, y, z], axis=-1) * np.asarray(half), turn[0], rise[:, 0])
    above = np.stack([(x.ravel() + 1) / 2, (y.ravel() + 1) / 2], axis=1)
    return Mesh(mesh.vertices, mesh.faces, above)
