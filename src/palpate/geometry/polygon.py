"""Convex polygons in the plane: (k, 2) corners, m, counterclockwise. Fewer than three corners have
no inside."""

from __future__ import annotations

import numpy as np

from palpate.geometry.pose import Array

STRAIGHT = 1e-12
"""Of the square of its size: what a corner adds less to a hull's area lies on one of its sides."""


def hull(points: Array) -> Array:
    """(m, 2) corners of the convex hull of (k, 2) points; the two ends where all lie in a line.

    From left to right along what is below, and back along what is above (Andrew's monotone chain).
    """
    if len(points) < 2:
        return points
    in_order = points[np.lexsort(points.T[::-1])]
    least = STRAIGHT * float(np.ptp(points, axis=0).max()) ** 2
    corners: list[list[float]] = in_order.tolist()
    below, over = _turning_left(corners, least), _turning_left(corners[::-1], least)
    return np.array([*below[:-1], *over[:-1]])


def _turning_left(points: list[list[float]], least: float) -> list[list[float]]:
    """Subset of points in order that makes left turns only."""
    kept: list[list[float]] = []
    for x, y in points:
        while len(kept) > 1:
            (x0, y0), (x1, y1) = kept[-2:]
            if (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) > least:
                break
            kept.pop()
        kept.append([x, y])
    return kept


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
