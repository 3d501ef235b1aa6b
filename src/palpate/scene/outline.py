"""Outlines of convex shapes seen from above: slices, widths, clearances. All points are in the world, m."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from palpate.pose import Array


def slab(points: Array, low: float, high: float) -> Array:
    """(k, 2) x-y points whose hull is the part of the convex hull of `points` (n, 3) between two heights."""
    inside = points[(points[:, 2] >= low) & (points[:, 2] <= high)]
    parts = [inside[:, :2]]
    for level in (low, high):
        below, above = points[points[:, 2] < level], points[points[:, 2] > level]
        if len(below) and len(above):
            a, b = below[:, None, :], above[None, :, :]
            share = (level - a[..., 2:]) / (b[..., 2:] - a[..., 2:])
            parts.append((a[..., :2] + share * (b[..., :2] - a[..., :2])).reshape(-1, 2))
    return rim(np.concatenate(parts))


def rim(points: Array) -> Array:
    """Those of (n, 2) points that are farthest out in one of many directions."""
    if len(points) < 3:
        return points
    return points[np.unique(np.argmax(points @ fan(180).T, axis=0))]


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


def profile(outlines: Sequence[Array], along: Array, across: Array, stations: Array) -> tuple[Array, Array]:
    """Lowest and highest coordinate across at each station along, over convex outlines; nan where there is none."""
    low, high = np.full(len(stations), np.inf), np.full(len(stations), -np.inf)
    for outline in outlines:
        s, w = outline @ along, outline @ across
        first, second = np.triu_indices(len(s), 1)
        near, far = np.minimum(s[first], s[second]), np.maximum(s[first], s[second])
        span = np.where(far - near > 1e-12, s[second] - s[first], 1.0)
        at = w[first] + (stations[:, None] - s[first]) * ((w[second] - w[first]) / span)
        spans = (stations[:, None] >= near) & (stations[:, None] <= far) & (far - near > 1e-12)
        low = np.minimum(low, np.where(spans, at, np.inf).min(axis=1, initial=np.inf))
        high = np.maximum(high, np.where(spans, at, -np.inf).max(axis=1, initial=-np.inf))
    empty = ~np.isfinite(low)
    return np.where(empty, np.nan, low), np.where(empty, np.nan, high)


def rectangle(centre: Array, along: Array, half_along: float, half_across: float) -> Array:
    """(4, 2) corners."""
    across = np.array([-along[1], along[0]])
    return np.array([centre + i * half_along * along + j * half_across * across for i in (-1, 1) for j in (-1, 1)])


def clearance(shape: Array, spots: Array, obstacles: Sequence[Array]) -> Array:
    """(n,) horizontal distance from `shape` (k, 2), moved by each of `spots` (n, 2), to the nearest obstacle.

    Negative where they overlap (by how much one must move), inf without obstacles; a lower bound, exact to a few
    per cent, from separating lines in 32 directions.
    """
    best = np.full(len(spots), np.inf)
    directions = fan(32)
    reach = (shape @ -directions.T).max(axis=0)
    travel = spots @ directions.T
    for obstacle in obstacles:
        gap = travel - reach - (obstacle @ directions.T).max(axis=0)
        best = np.minimum(best, gap.max(axis=1))
    return best
