"""What carries an object, and how much of it: outlines seen from above.

An object stands where its lower face is over tops at its height. The hull of what of the face is
carried is its support polygon; it stays where its centre of mass is over that.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from palpate.geometry.outline import rim, slab
from palpate.geometry.pose import Array, Pose
from palpate.vocabulary.admissible.solids import ORIGIN, Shape, Solids, digits, solids
from palpate.vocabulary.state import SymbolicState

SETTLES = 0.005
"""m: a top this far below the lowest point of an object, or above it, carries it."""
FACE = 0.002
"""m above the lowest point up to which an object's face reaches."""
SUNK = 0.02
"""m: a top this far above an object's lowest point still is below it, by belief."""


@dataclass(frozen=True, slots=True, eq=False)
class Top:
    """What something looks like from above near its top: whose it is, (k, 2) corners of its
    outline counterclockwise, and its height, world z, m."""

    owner: str
    outline: Array
    height: float


@dataclass(frozen=True, eq=False)
class Footing:
    """An object at a pose, and what is below it.

    Attributes:
        bottom: world z of its lowest point, m.
        outline, face: (k, 2) corners of all of it seen from above, and of its lowest part.
        tops: what reaches under it, wherever that ends.
    """

    name: str
    bottom: float
    outline: Array
    face: Array
    tops: tuple[Top, ...]

    @cached_property
    def carriers(self) -> tuple[Top, ...]:
        """Those at its height."""
        return tuple(top for top in self.tops if abs(top.height - self.bottom) <= SETTLES)

    @cached_property
    def support(self) -> Array:
        """(k, 2) corners of its support polygon; fewer than three where nothing carries it."""
        parts = [clipped(self.face, top.outline) for top in self.carriers]
        return hull(np.concatenate([np.zeros((0, 2)), *parts]))

    @property
    def gap(self) -> float:
        """m down to the highest top below it; inf where there is none."""
        return self.bottom - max((top.height for top in self.tops), default=-np.inf)


def footing(state: SymbolicState, name: str, pose_world_object: Pose) -> Footing:
    """The footing of an object at a pose, among everything that is not held, and itself left out."""
    shapes = solids(state.scene)
    placed = [entry for entry in state.placed if entry[0] != name]
    key = ("footing", name, digits(pose_world_object.vector), state.holding, *placed)
    return shapes.remembered(key, lambda: _footing(shapes, state, name, pose_world_object))


def _footing(shapes: Solids, state: SymbolicState, name: str, pose: Pose) -> Footing:
    parts = [shapes.convex(shape, pose) for shape in shapes.objects[name]]
    points = np.concatenate([part.points for part in parts])
    bottom = float(points[:, 2].min())
    faces = [slab(part, bottom, bottom + FACE) for part in parts]
    outline, face = hull(rim(points[:, :2])), hull(np.concatenate(faces))
    tops = [
        top
        for top in _tops(shapes, _others(shapes, state, name), outline, bottom)
        if len(clipped(outline, top.outline)) > 2
    ]
    return Footing(name, bottom, outline, face, tuple(tops))


def _others(shapes: Solids, state: SymbolicState, name: str) -> Iterator[tuple[str, Shape, Pose]]:
    for shape in shapes.fixed:
        yield shapes.owners[shape.geom], shape, ORIGIN
    for other in state.scene.objects:
        if other not in (name, state.holding):
            for shape in shapes.objects[other]:
                yield other, shape, state.pose_of(other)


def _tops(
    shapes: Solids, others: Iterable[tuple[str, Shape, Pose]], outline: Array, bottom: float
) -> Iterator[Top]:
    """The tops of those that reach under an outline."""
    low, high = outline.min(axis=0), outline.max(axis=0)
    for owner, shape, pose in others:
        reach = float(shapes.radii[shape.geom]) or np.inf
        middle = pose.apply(shape.position)[:2]
        if (middle + reach < low).any() or (middle - reach > high).any():
            continue
        part = shapes.convex(shape, pose)
        height = float(part.points[:, 2].max())
        if height > bottom + SUNK:
            continue
        yield Top(owner, hull(slab(part, height - FACE, height)), height)


def hull(points: Array) -> Array:
    """(m, 2) corners of the convex hull of (k, 2) points, counterclockwise (Andrew's monotone
    chain)."""
    ordered = points[np.lexsort((points[:, 1], points[:, 0]))]
    lower, upper = _chain(ordered), _chain(ordered[::-1])
    return np.array([*lower[:-1], *upper[:-1]]).reshape(-1, 2)


def _chain(ordered: Array) -> list[Array]:
    chain: list[Array] = []
    for point in ordered:
        while len(chain) > 1 and _cross(chain[-1] - chain[-2], point - chain[-1]) <= 1e-12:
            chain.pop()
        chain.append(point)
    return chain


def clipped(polygon: Array, by: Array) -> Array:
    """(m, 2) corners of the part of a convex polygon that lies in another, both counterclockwise
    (Sutherland and Hodgman)."""
    if len(by) < 3:
        return np.zeros((0, 2))
    left = list(polygon)
    for start, end in zip(by, np.roll(by, -1, axis=0), strict=True):
        inside = [_cross(end - start, point - start) for point in left]
        kept: list[Array] = []
        for i, point in enumerate(left):
            if inside[i - 1] * inside[i] < 0:
                share = inside[i - 1] / (inside[i - 1] - inside[i])
                kept.append(left[i - 1] + share * (point - left[i - 1]))
            if inside[i] >= 0:
                kept.append(point)
        left = kept
    return np.array(left).reshape(-1, 2)


def depth(polygon: Array, point: Array) -> float:
    """m that a point is inside a convex polygon, counterclockwise; negative outside."""
    if len(polygon) < 3:
        return -np.inf
    sides = np.roll(polygon, -1, axis=0) - polygon
    from_corners = point - polygon
    crossed = sides[:, 0] * from_corners[:, 1] - sides[:, 1] * from_corners[:, 0]
    return float((crossed / np.hypot(sides[:, 0], sides[:, 1])).min())


def _cross(a: Array, b: Array) -> float:
    return float(a[0] * b[1] - a[1] * b[0])
