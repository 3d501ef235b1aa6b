"""Support of an object: its carriers and their shares, by outlines seen from above.

An object stands where its lower face is over tops at its height. The hull of what of the face is
carried is its support polygon; it stays where its centre of mass is over that.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from palpate.geometry.outline import clipped, hull, rim, slab
from palpate.geometry.pose import Array, Pose
from palpate.vocabulary.admissible.solids import ORIGIN, Solids, solids
from palpate.vocabulary.admissible.sweep.frames import Shape
from palpate.vocabulary.state import SymbolicState

SETTLES = 0.005
"""m: a top this far below the lowest point of an object, or above it, carries it."""
FACE = 0.002
"""m above the lowest point up to which an object's face reaches."""
SUNK = 0.02
"""m: a top this far above an object's lowest point still is below it, by belief."""


@dataclass(frozen=True, slots=True, eq=False)
class Top:
    """Top view of a body near its top: owner, (k, 2) corners of its outline counterclockwise, and
    height, world z, m."""

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
        """Tops at its height."""
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
    key = ("footing", name, pose_world_object.digits, state.holding, *placed)
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
    """The tops of those that reach under an outline, and of those in which its bottom would be."""
    low, high = outline.min(axis=0), outline.max(axis=0)
    for owner, shape, pose in others:
        reach = float(shapes.radii[shape.geom]) or np.inf
        middle = pose.apply(shape.position)[:2]
        if (middle + reach < low).any() or (middle - reach > high).any():
            continue
        part = shapes.convex(shape, pose)
        foot, height = float(part.points[:, 2].min()), float(part.points[:, 2].max())
        if height > bottom + SUNK and foot > bottom:
            continue
        yield Top(owner, hull(slab(part, height - FACE, height)), height)
