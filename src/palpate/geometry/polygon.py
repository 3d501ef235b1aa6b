"""Convex polygons in the plane: (k, 2) corners, m, counterclockwise. Fewer than three corners have
no inside."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from palpate.geometry.pose import Array


def hull(points: Array) -> Array:
    """(m, 2) corners of the convex hull of (k, 2) points; the two ends where all lie in a line."""
    from scipy.spatial import ConvexHull, QhullError

    if len(points) > 2:
        with suppress(QhullError):  # it finds no area
            return points[ConvexHull(points).vertices]
    in_order = np.lexsort(points.T[::-1])
    return points[in_order[[0, -1]]] if len(points) > 1 else points


def clipped(polygon: Array, by: Array) -> Array:
    """(m, 2) corners of the part of a polygon that lies in another.

    The line of each side of the other cuts off what lies on its right (Sutherland and Hodgman).
    """
    if len(by) < 3:
        return np.zeros((0, 2))
    left = polygon
    for start, end in zip(by, np.roll(by, -1, axis=0), strict=True):
        left = _left_of(left, start, end)
    return left


def _left_of(polygon: Array, start: Array, end: Array) -> Array:
    """The part of a polygon on the left of a line through two points."""
    inside = _cross(end - start, polygon - start)
    before, came_from = np.roll(polygon, 1, axis=0), np.roll(inside, 1)
    kept: list[Array] = []
    for corner, there, last, here in zip(polygon, inside, before, came_from, strict=True):
        if here * there < 0:
            kept.append(last + here / (here - there) * (corner - last))
        if there >= 0:
            kept.append(corner)
    return np.array(kept).reshape(-1, 2)


def depth(polygon: Array, point: Array) -> float:
    """m that a point is inside a polygon; negative outside."""
    if len(polygon) < 3:
        return -np.inf
    sides = np.roll(polygon, -1, axis=0) - polygon
    return float((_cross(sides, point - polygon) / np.hypot(sides[:, 0], sides[:, 1])).min())


def _cross(a: Array, b: Array) -> Array:
    """(k,) the third component of the cross products of (k, 2) vectors."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
