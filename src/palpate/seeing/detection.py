"""Tags in a picture. A corner is where two sides meet: lines through their edges, each point of which is found to a
fraction of a pixel across the side, in the picture without the lens's distortion, where sides are straight.
"""

from __future__ import annotations

import numpy as np

from palpate.geometry.pose import Array
from palpate.seeing.lens import Lens
from palpate.seeing.vision import MODULES, Grey, remapped, squares, undistorted

ALONG = np.linspace(0.12, 0.88, 32)
"""Places along a side, as shares of it: at its ends the next side is near."""
ACROSS = np.arange(-2.5, 2.6, 0.25)
"""Pixels out of the square at which a picture is read. An edge out of focus by a pixel is within them."""
NEXT = 0.6
"""Of a module, to either side of an edge: beyond are the next ones."""
FAINT = 1e-6
"""Weight of a place without an edge: there a side is where it was."""
ROUNDS = 2
"""Searches of the edges, the second along sides that are nearly where they should be."""


def detect(grey: Grey, lens: Lens) -> list[tuple[int, Array]]:
    """Tags in a picture through a lens: number and corners (4, 2), pixels, clockwise from the upper left as printed."""
    found: list[tuple[int, Array]] = []
    for number, rough in squares(grey):
        fine = rough
        for _ in range(ROUNDS):
            fine = _refined(grey, fine, lens)
        # A side that something covers leads elsewhere.
        within = np.abs(fine - rough).max() < _module(rough)
        found.append((number, fine if within else rough))
    return found


def _module(corners: Array) -> float:
    """Pixels of a module along the shortest side."""
    sides = np.roll(corners, -1, axis=0) - corners
    return float(np.linalg.norm(sides, axis=1).min()) / MODULES


def _refined(grey: Grey, corners: Array, lens: Lens) -> Array:
    """Corners (4, 2) of a square by its edges near where they are believed to be."""
    sides = np.roll(corners, -1, axis=0) - corners
    outward = np.stack([sides[:, 1], -sides[:, 0]], axis=1)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    near = ACROSS[np.abs(ACROSS) <= max(1.0, NEXT * _module(corners))]
    places = corners[:, None] + ALONG[:, None] * sides[:, None]
    read = places[:, :, None] + near[:, None] * outward[:, None, None]
    light = remapped(grey, read.reshape(-1, len(near), 2)).reshape(*read.shape[:3]).astype(float)
    # Black within, white without: the edge is the middle of the rise, weighted by its square.
    rise = np.maximum(np.diff(light), 0.0) ** 2
    weight = rise.sum(axis=2)
    middle = (rise @ ((near[1:] + near[:-1]) / 2)) / np.maximum(weight, FAINT)
    points = places + middle[..., None] * outward[:, None]
    straight = undistorted(lens, points.reshape(-1, 2)).reshape(points.shape)
    return _distorted(lens, _meetings(straight, np.sqrt(weight) + FAINT))


def _meetings(points: Array, weights: Array) -> Array:
    """(4, 2) where each line meets the one before it: total least squares through points (4, n, 2)."""
    weights = weights / weights.sum(axis=1, keepdims=True)
    centres = np.einsum("ij,ijk->ik", weights, points)
    off = points - centres[:, None]
    # The normal is the direction of least spread.
    normals = np.linalg.eigh(np.einsum("ij,ijk,ijl->ikl", weights, off, off))[1][..., 0]
    offsets = np.einsum("ij,ij->i", normals, centres)
    lines = np.stack([np.roll(normals, 1, axis=0), normals], axis=1)
    return np.linalg.solve(lines, np.stack([np.roll(offsets, 1), offsets], axis=1)[..., None])[
        ..., 0
    ]


def _distorted(lens: Lens, pixels: Array) -> Array:
    """(n, 2) where pixels (n, 2) of the lens without distortion are seen through it."""
    rays = np.column_stack([pixels, np.ones(len(pixels))]) @ np.linalg.inv(lens.matrix).T
    return lens.project(rays)
