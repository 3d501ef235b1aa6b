"""Resting pose of a body on a level plane, from a pose in which it is not stable."""

from __future__ import annotations

import numpy as np

from palpate.geometry.outline import depth, hull
from palpate.geometry.pose import Array, Pose

TOUCHING = 1e-4
"""m above the plane, up to which a point touches it."""
STEADY = 5e-4
"""m that a centre of mass may be outside its support polygon: round bodies are polygons here."""
MOST = np.radians(5.0)
"""rad: a body that would turn by more does not rest on that plane alone, or is to be held."""
TIPS = 8
"""Largest number of edges over which a body tips in turn."""


def tipped(points: Array, centre: Array) -> Pose:
    """Motion in the world that brings a body to rest on the level plane through its lowest point.

    `points` (k, 3) are the corners of its convex hull, `centre` (3,) its centre of mass. As long as
    that is outside the support polygon, the body tips over the nearest edge until more of it touches.
    No motion for a body that is stable, or that would turn by more than `MOST`.
    """
    unmoved = Pose.of(np.zeros(3))
    moved, turned = unmoved, 0.0
    for _ in range(TIPS):
        tip = _tip(points @ moved.rotation.T + moved.position, moved.apply(centre))
        if tip is None:
            return moved
        moved = tip @ moved
        turned = unmoved.angle_to(moved)
        if turned > MOST:
            return unmoved
    return unmoved


def _tip(points: Array, centre: Array) -> Pose | None:
    """Tip once about the support until another point touches; None where the body is stable."""
    plane = float(points[:, 2].min())
    touching = points[:, 2] < plane + TOUCHING
    edge = _nearest(hull(points[touching, :2]), centre[:2])
    beside = centre[:2] - edge
    distance = float(np.hypot(*beside))
    if distance < STEADY:
        return None
    way = beside / distance
    along = (points[:, :2] - edge) @ way
    landing = ~touching & (along > 0.0)
    if not landing.any():
        return None
    # The point that lands first subtends the smallest angle with the plane at the edge.
    angle = float(np.arctan2(points[landing, 2] - plane, along[landing]).min())
    half = 0.5 * angle
    axis = np.array([-way[1], way[0], 0.0])
    turn = Pose.of(np.zeros(3), [np.cos(half), *(np.sin(half) * axis)])
    foot = np.array([*edge, plane])
    return Pose.of(foot - turn.apply(foot), turn.quaternion)


def _nearest(polygon: Array, point: Array) -> Array:
    """(2,) point of a convex polygon, a line or a single point, nearest to `point`."""
    if depth(polygon, point) >= 0.0:
        return point
    best = polygon[0]
    for start, end in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        side = end - start
        share = float((point - start) @ side) / max(float(side @ side), 1e-18)
        there = start + np.clip(share, 0.0, 1.0) * side
        if np.hypot(*(point - there)) < np.hypot(*(point - best)):
            best = there
    return best
