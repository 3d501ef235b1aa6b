"""Outlines of convex shapes seen from above: slices, widths, clearances. All points are in the
world, m.

A thing is handled as what it looks like from above: the hull of (k, 2) x-y points. The part of it
between two heights, which is what fingers at these heights meet, is again such a hull.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from palpate.geometry.pose import Array

_CORNERS = 72
"""Directions in which outlines are sampled; round things are true to 0.1 %."""


@dataclass(frozen=True, slots=True, eq=False)
class Obstacle:
    """Something solid: its outline from above, (k, 2), and the world z of its top, m."""

    outline: Array
    top: float

    @classmethod
    def of(cls, points: Array) -> Obstacle:
        """Around (n, 3) points."""
        return cls(rim(points[:, :2]), float(points[:, 2].max()))


def above(obstacles: Iterable[Obstacle], height: float) -> list[Array]:
    """Outlines of what reaches above a height."""
    return [obstacle.outline for obstacle in obstacles if obstacle.top > height]


@dataclass(frozen=True, slots=True, eq=False)
class Convex:
    """A convex shape: (n, 3) points, and (m, 2) index pairs among which all edges of its hull
    are."""

    points: Array
    edges: NDArray[np.intp]


def slab(shape: Convex, low: float, high: float) -> Array:
    """(k, 2) x-y points whose hull is the part of the shape between two heights.

    Its corners are those of the shape that lie between, and the points at which an edge of the
    shape passes through either height.
    """
    z = shape.points[:, 2]
    parts = [shape.points[(z >= low) & (z <= high), :2]]
    start, end = shape.points[shape.edges[:, 0]], shape.points[shape.edges[:, 1]]
    for level in (low, high):
        crossing = (start[:, 2] - level) * (end[:, 2] - level) < 0  # one end above, one below
        a, b = start[crossing], end[crossing]
        parts.append(a[:, :2] + (level - a[:, 2:]) / (b[:, 2:] - a[:, 2:]) * (b[:, :2] - a[:, :2]))
    return rim(np.concatenate(parts))


def rim(points: Array) -> Array:
    """Points of (n, 2) that are farthest out in one of many directions."""
    if len(points) < 3:
        return points
    return points[np.unique(np.argmax(fan(_CORNERS) @ points.T, axis=1))]


@cache
def fan(count: int) -> Array:
    """(count, 2) unit vectors evenly around the circle."""
    angle = np.arange(count) * 2 * np.pi / count
    return np.column_stack([np.cos(angle), np.sin(angle)])


def unit(angle: float) -> Array:
    """(2,) unit vector at `angle` rad from x."""
    return np.array([np.cos(angle), np.sin(angle)])


def width(points: Array, direction: Array) -> float:
    """Extent of (n, 2) points along a unit vector."""
    along = points @ direction
    return float(along.max() - along.min())


def profile(
    outlines: Sequence[Array], along: Array, across: Array, stations: Array
) -> tuple[Array, Array]:
    """Lowest and highest coordinate across at each station along, over convex outlines; nan where
    there is none.

    A line across at one station meets the hull of an outline first and last on chords between two
    of its points; so every pair of points is tried, and the lowest and highest chord win.
    """
    low, high = np.full(len(stations), np.inf), np.full(len(stations), -np.inf)
    for outline in outlines:
        s, w = outline @ along, outline @ across
        first, second = np.triu_indices(len(s), 1)
        near, far = np.minimum(s[first], s[second]), np.maximum(s[first], s[second])
        slanted = far - near > 1e-12
        span = np.where(slanted, s[second] - s[first], 1.0)
        at = w[first] + (stations[:, None] - s[first]) * ((w[second] - w[first]) / span)
        spans = (stations[:, None] >= near) & (stations[:, None] <= far) & slanted
        low = np.minimum(low, np.where(spans, at, np.inf).min(axis=1, initial=np.inf))
        high = np.maximum(high, np.where(spans, at, -np.inf).max(axis=1, initial=-np.inf))
    empty = ~np.isfinite(low)
    return np.where(empty, np.nan, low), np.where(empty, np.nan, high)


def rectangle(centre: Array, along: Array, half_along: float, half_across: float) -> Array:
    """(4, 2) corners."""
    across = np.array([-along[1], along[0]])
    corners: list[Array] = []
    for i, j in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        corners.append(centre + i * half_along * along + j * half_across * across)
    return np.array(corners)


def clearance(shape: Array, spots: Array, obstacles: Sequence[Array]) -> Array:
    """(n,) horizontal distance from `shape` (k, 2), moved by each of `spots` (n, 2), to the nearest
    obstacle.

    Negative where they overlap (by how much one must move), inf without obstacles; a lower bound,
    at most a twentieth of the shapes' size too small, from separating lines in 64 directions.

    Two convex outlines are apart if some line runs between them. Looking along each direction, the
    gap is how far the shape's nearest point is beyond the obstacle's farthest one; the widest gap
    of all directions is the distance.
    """
    best = np.full(len(spots), np.inf)
    directions = fan(64)
    reach = (shape @ -directions.T).max(axis=0)
    travel = spots @ directions.T
    for obstacle in obstacles:
        gap = travel - reach - (obstacle @ directions.T).max(axis=0)
        best = np.minimum(best, gap.max(axis=1))
    return best
