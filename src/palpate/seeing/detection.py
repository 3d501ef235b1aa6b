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
ROUNDS, DONE = 6, 0.03
"""Searches of the edges, each along sides that are nearer to where they should be, until none moves a corner by
more than these pixels: two, but where a corner was taken for one of the paper."""
STRAIGHT = 0.3
"""Pixels, rms, of a side's edge from its line. It is below 0.1, and above 0.4 where a part is another thing's."""
FARTHEST = 1.5
"""Modules from where a corner was found roughly: at the paper's corner, at most."""


def detect(grey: Grey, lens: Lens) -> list[tuple[int, Array]]:
    """Tags in a picture through a lens: number and corners (4, 2), pixels, clockwise from the upper left as printed."""
    return [(number, _fine(grey, rough, lens)) for number, rough in squares(grey)]


def _fine(grey: Grey, rough: Array, lens: Lens) -> Array:
    """Corners (4, 2) by the edges near rough ones, which stay where these are not straight, or lead elsewhere."""
    fine, bent = rough, 0.0
    for _ in range(ROUNDS):
        before = fine
        fine, bent = _refined(grey, fine, lens)
        if np.abs(fine - before).max() < DONE:
            break
    within = np.abs(fine - rough).max() < FARTHEST * _module(rough)
    return fine if within and bent < STRAIGHT else rough


def _module(corners: Array) -> float:
    """Pixels of a module along the shortest side."""
    sides = np.roll(corners, -1, axis=0) - corners
    return float(np.linalg.norm(sides, axis=1).min()) / MODULES


def _refined(grey: Grey, corners: Array, lens: Lens) -> tuple[Array, float]:
    """Corners (4, 2) of a square by its edges near where they are believed to be, and pixels by which the least
    straight one is not."""
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
    meetings, bent = _meetings(straight, np.sqrt(weight) + FAINT)
    return _distorted(lens, meetings), bent


def _meetings(points: Array, weights: Array) -> tuple[Array, float]:
    """(4, 2) where each line meets the one before it, total least squares through points (4, n, 2), and the largest
    deviation of points from a line, rms."""
    weights = weights / weights.sum(axis=1, keepdims=True)
    centres = np.einsum("ij,ijk->ik", weights, points)
    off = points - centres[:, None]
    # The normal is the direction of least spread.
    spread, axes = np.linalg.eigh(np.einsum("ij,ijk,ijl->ikl", weights, off, off))
    normals = axes[..., 0]
    offsets = np.einsum("ij,ij->i", normals, centres)
    lines = np.stack([np.roll(normals, 1, axis=0), normals], axis=1)
    right = np.stack([np.roll(offsets, 1), offsets], axis=1)[..., None]
    return np.linalg.solve(lines, right)[..., 0], float(np.sqrt(spread[:, 0].max(initial=0.0)))


def _distorted(lens: Lens, pixels: Array) -> Array:
    """(n, 2) where pixels (n, 2) of the lens without distortion are seen through it."""
    rays = np.column_stack([pixels, np.ones(len(pixels))]) @ np.linalg.inv(lens.matrix).T
    return lens.project(rays)
