"""Outlines of bodies seen from above, and resting poses of a body."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array, Pose

# Number of directions in which outlines are sampled; round shapes are accurate to 0.1 %.
_CORNERS = 72
# Share of the squared size: a corner that adds less to a hull's area lies on a side of the hull.
_STRAIGHT = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class Obstacle:
    """A solid body: its outline from above, (k, 2), and the world z of its top, m."""

    outline: Array
    top: float

    @classmethod
    def of(cls, points: Array) -> Obstacle:
        """Make the obstacle around points (n, 3)."""
        return cls(rim(points[:, :2]), float(points[:, 2].max()))


def above(obstacles: Iterable[Obstacle], height: float) -> list[Array]:
    """Return the outlines of the obstacles that reach above a height."""
    return [obstacle.outline for obstacle in obstacles if obstacle.top > height]


@dataclass(frozen=True, slots=True, eq=False)
class Convex:
    """A convex shape: points (n, 3), and index pairs (m, 2) that include all edges of its hull."""

    points: Array
    edges: NDArray[np.intp]


def slab(shape: Convex, low: float, high: float) -> Array:
    """Compute x-y points (k, 2) whose hull is the part of the shape between two heights."""
    z = shape.points[:, 2]
    # Its corners are the shape's points between the heights, and the intersections of edges with both
    # heights.
    parts = [shape.points[(z >= low) & (z <= high), :2]]
    start, end = shape.points[shape.edges[:, 0]], shape.points[shape.edges[:, 1]]
    for level in (low, high):
        crossing = (start[:, 2] - level) * (end[:, 2] - level) < 0  # one end above, one below
        a, b = start[crossing], end[crossing]
        parts.append(a[:, :2] + (level - a[:, 2:]) / (b[:, 2:] - a[:, 2:]) * (b[:, :2] - a[:, :2]))
    return rim(np.concatenate(parts))


def rim(points: Array) -> Array:
    """Select the points (n, 2) that are extreme in one of 72 directions."""
    if len(points) < 3:
        return points
    return points[np.unique(np.argmax(_fan(_CORNERS) @ points.T, axis=1))]


@cache
def _fan(count: int) -> Array:
    """Compute unit vectors (count, 2), evenly spaced around the circle."""
    angle = np.arange(count) * 2 * np.pi / count
    return np.column_stack([np.cos(angle), np.sin(angle)])


def unit(angle: float) -> Array:
    """Return the unit vector (2,) at `angle` rad from x."""
    return np.array([np.cos(angle), np.sin(angle)])


def width(points: Array, direction: Array) -> float:
    """Compute the extent of points (n, 2) along a unit vector."""
    along = points @ direction
    return float(along.max() - along.min())


def profile(
    outlines: Sequence[Array], along: Array, across: Array, stations: Array
) -> tuple[Array, Array]:
    """Compute the lowest and highest coordinate across at each station along, over convex outlines.

    The result is nan at stations that no outline reaches.
    """
    low, high = np.full(len(stations), np.inf), np.full(len(stations), -np.inf)
    for outline in outlines:
        s, w = outline @ along, outline @ across
        # A line across enters and leaves the hull on chords between two of its points. The lowest and the
        # highest chord over all pairs of points are the hull's ends.
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
    """Return the corners (4, 2)."""
    across = np.array([-along[1], along[0]])
    corners: list[Array] = []
    for i, j in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        corners.append(centre + i * half_along * along + j * half_across * across)
    return np.array(corners)


def clearance(shape: Array, spots: Array, obstacles: Sequence[Array]) -> Array:
    """Compute the horizontal distance (n,), m, from `shape` (k, 2), moved by each of `spots` (n, 2), to the
    nearest obstacle.

    It is negative where they overlap (by the depth), and inf without obstacles. It is a lower bound, too
    small by at most a twentieth of the shapes' size.
    """
    # Two convex outlines are disjoint if a line separates them. The gap in a direction is from the shape's
    # nearest point to the obstacle's farthest one. The distance is the widest gap, here over 64 directions.
    best = np.full(len(spots), np.inf)
    directions = _fan(64)
    reach = (shape @ -directions.T).max(axis=0)
    travel = spots @ directions.T
    for obstacle in obstacles:
        gap = travel - reach - (obstacle @ directions.T).max(axis=0)
        best = np.minimum(best, gap.max(axis=1))
    return best


def hull(points: Array) -> Array:
    """Compute the corners (m, 2) of the convex hull of points (k, 2); the two ends if all lie on a line."""
    if len(points) < 2:
        return points
    # Andrew's monotone chain: the lower half from left to right, the upper half from right to left.
    in_order = points[np.lexsort(points.T[::-1])]
    least = _STRAIGHT * float(np.ptp(points, axis=0).max()) ** 2
    corners: list[list[float]] = in_order.tolist()
    below, over = _turning_left(corners, least), _turning_left(corners[::-1], least)
    return np.array([*below[:-1], *over[:-1]])


def _turning_left(points: list[list[float]], least: float) -> list[list[float]]:
    """Select the points, in order, that make left turns only."""
    kept: list[list[float]] = []
    for x, y in points:
        while len(kept) > 1:
            (x0, y0), (x1, y1) = kept[-2:]
            if (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) > least:
                break
            kept.pop()
        kept.append([x, y])
    return kept


def clip_polygon(polygon: Array, by: Array) -> Array:
    """Compute the corners (m, 2) of the intersection of two polygons (Sutherland and Hodgman)."""
    # Clip the polygon by each side in turn.
    if len(by) < 3:
        return np.zeros((0, 2))
    corners: list[list[float]] = by.tolist()
    left: list[list[float]] = polygon.tolist()
    for (x0, y0), (x1, y1) in zip(corners, [*corners[1:], corners[0]], strict=True):
        # Each side of `by` cuts off the part to its right.
        inside = [(x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) for x, y in left]
        kept: list[list[float]] = []
        for i, ((x, y), next_side) in enumerate(zip(left, inside, strict=True)):
            (from_x, from_y), side = left[i - 1], inside[i - 1]
            # Keep the corners inside, and add the intersections with the side.
            if side * next_side < 0:
                share = side / (side - next_side)
                kept.append([from_x + share * (x - from_x), from_y + share * (y - from_y)])
            if next_side >= 0:
                kept.append([x, y])
        left = kept
    return np.array(left).reshape(-1, 2)


def depth(polygon: Array, point: Array) -> float:
    """Compute the distance, m, from a point inside to the polygon's nearest side; negative outside."""
    if len(polygon) < 3:
        return -np.inf
    # Signed distance from each side; positive inside for counterclockwise corners.
    sides = np.roll(polygon, -1, axis=0) - polygon
    return float((_cross(sides, point - polygon) / np.hypot(sides[:, 0], sides[:, 1])).min())


def _cross(a: Array, b: Array) -> Array:
    """Compute the third component (k,) of the cross products of vectors (k, 2)."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


# Resting pose of a body on a level plane, from a pose in which it is not stable.

TOUCHING = 1e-4  # m above the plane, up to which a point counts as touching
# m by which a centre of mass may be outside its support polygon: round bodies are polygons here.
STEADY = 5e-4
# rad: a body that would turn by more does not rest on that plane alone, or will be held.
MOST = np.radians(5.0)
TIPS = 8  # Largest number of edges over which a body tips in sequence


def tip_to_rest(points: Array, centre: Array) -> Pose:
    """Compute the motion in the world that brings a body to rest on the level plane through its lowest point.

    `points` (k, 3) are the corners of its convex hull, `centre` (3,) is its centre of mass. While the
    centre is outside the support polygon, the body tips over the nearest edge until another part touches.
    There is no motion for a body that is stable, or that would turn by more than `MOST`.
    """
    # Tip until the body is stable, or has turned too far.
    unmoved = Pose.of(np.zeros(3))
    pose, angle = unmoved, 0.0
    for _ in range(TIPS):
        tip = _tip(points @ pose.rotation.T + pose.position, pose.apply(centre))
        if tip is None:
            return pose
        pose = tip @ pose
        angle = unmoved.angle_to(pose)
        if angle > MOST:
            return unmoved
    return unmoved


def _tip(points: Array, centre: Array) -> Pose | None:
    """Tip once about the support until another point touches; None where the body is stable."""
    # Support polygon, and its point nearest to the centre of mass, about which the body tips.
    plane = float(points[:, 2].min())
    touching = points[:, 2] < plane + TOUCHING
    edge = _nearest(hull(points[touching, :2]), centre[:2])
    across = centre[:2] - edge
    distance = float(np.hypot(*across))
    if distance < STEADY:
        return None
    # Points in the tipping direction can land on the plane.
    direction = across / distance
    along = (points[:, :2] - edge) @ direction
    landing = ~touching & (along > 0.0)
    if not landing.any():
        return None
    # The point that lands first subtends the smallest angle with the plane at the edge.
    angle = float(np.arctan2(points[landing, 2] - plane, along[landing]).min())
    # Rotation about the horizontal edge through the nearest point.
    half = 0.5 * angle
    axis = np.array([-direction[1], direction[0], 0.0])
    turn = Pose.of(np.zeros(3), [np.cos(half), *(np.sin(half) * axis)])
    foot = np.array([*edge, plane])
    return Pose.of(foot - turn.apply(foot), turn.quaternion)


def _nearest(polygon: Array, point: Array) -> Array:
    """Compute the point (2,) of a convex polygon, a line or a single point nearest to `point`."""
    if depth(polygon, point) >= 0.0:
        return point
    # Project on each side, and keep the nearest projection.
    best = polygon[0]
    for start, end in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        side = end - start
        share = float((point - start) @ side) / max(float(side @ side), 1e-18)
        closest = start + np.clip(share, 0.0, 1.0) * side
        if np.hypot(*(point - closest)) < np.hypot(*(point - best)):
            best = closest
    return best
