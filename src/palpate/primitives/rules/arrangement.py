"""Arrangement: all static shapes around the arm, with bounding boxes for the broad phase.

Moving shapes are first compared with these boxes, for a whole motion at once. Exact distances are
measured only where boxes meet.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array, Frames
from palpate.primitives.rules.solids import Solids, solids
from palpate.primitives.state import SymbolicState

HIGHER = "higher"  # Kind of the raised copies of objects on a surface of unknown height


@dataclass(frozen=True, slots=True, eq=False)
class ShapePart:
    """A moving or static shape."""

    geom: int  # its id in the compiled scene
    kind: str  # `hand`, `load`, a finger's side, `link`, `higher`; else empty
    owner: str  # the body that it is part of


@dataclass(frozen=True, eq=False)
class Arrangement:
    """k static shapes."""

    parts: tuple[ShapePart, ...]  # the shapes
    frames: Frames  # their poses, at a single moment
    # middles, halves: centres and half extents (k, 3), m, of their bounding boxes in the world
    middles: Array
    halves: Array

    @classmethod
    def of(cls, shapes: Solids, parts: Sequence[ShapePart], frames: Frames) -> Arrangement:
        """Box the shapes at their poses."""
        turns, geoms = frames.rotations[0], [part.geom for part in parts]
        middles, halves = (boxes[geoms] for boxes in shapes.boxes)
        # Axis-aligned box of a rotated box: centre R c + p, half extents |R| h.
        middles = frames.positions[0] + np.einsum("kij,kj->ki", turns, middles)
        halves = np.einsum("kij,kj->ki", np.abs(turns), halves)
        return cls(tuple(parts), frames, middles, halves)

    @cached_property
    def geoms(self) -> NDArray[np.intp]:
        """(k,) ids of the shapes."""
        return np.array([part.geom for part in self.parts], dtype=np.intp)

    @cached_property
    def owners(self) -> NDArray[np.str_]:
        """(k,) names of the bodies of the shapes."""
        return np.array([part.owner for part in self.parts])

    def without(self, name: str) -> Arrangement:
        """All but the shapes of one body."""
        return self.select(np.flatnonzero(self.owners != name))

    def select(self, kept: NDArray[np.intp]) -> Arrangement:
        """Some of the shapes, by number."""
        # Keep parts, frames and boxes in the same order.
        numbers: list[int] = kept.tolist()
        frames = Frames(self.frames.positions[:, kept], self.frames.rotations[:, kept])
        parts = tuple(self.parts[i] for i in numbers)
        return Arrangement(parts, frames, self.middles[kept], self.halves[kept])

    def near(self, low: Array, high: Array) -> NDArray[np.bool_]:
        """(m, k) mask of the shapes whose boxes meet each of m boxes from `low` to `high` (m, 3), m."""
        # Two axis-aligned boxes overlap if their intervals overlap along all three axes.
        lowest, highest = self._ends
        above, below = lowest <= high.T[:, :, None], highest >= low.T[:, :, None]
        return np.asarray((above & below).all(axis=0))

    @cached_property
    def _ends(self) -> tuple[Array, Array]:
        """Least and greatest coordinates (3, 1, k) of the boxes, m."""
        ends = np.stack([self.middles - self.halves, self.middles + self.halves])
        lowest, highest = np.ascontiguousarray(ends.transpose(0, 2, 1))[:, :, None]
        return lowest, highest


def arrangement(state: SymbolicState, higher: Mapping[str, float]) -> Arrangement:
    """All static shapes: neither part of the arm, except its base, nor held.

    Each object in `higher` also appears a second time, raised by that many m.
    """
    # Cache the whole arrangement, and its selection without the held object.
    shapes, held = solids(state.scene), state.holding
    key = ("arrangement", *state.others(held), *sorted(higher.items()))
    whole = shapes.get_or_compute(key, lambda: _arrangement(shapes, state.without(held), higher))
    return (
        whole if held is None else shapes.get_or_compute((held, *key), lambda: whole.without(held))
    )


def _arrangement(shapes: Solids, state: SymbolicState, higher: Mapping[str, float]) -> Arrangement:
    """Arrangement of all fixed shapes and all objects at their believed poses."""
    # Fixed shapes first, then each object, and its raised copy where it may be higher.
    parts = [ShapePart(geom, "", shapes.owners[geom]) for geom in shapes.fixed.geoms]
    there = [shapes.standing]
    for name in state.scene.objects:
        for kind, rise in (("", 0.0), (HIGHER, higher.get(name, 0.0))):
            if kind and not rise:
                continue
            pose = state.pose_of(name).translate((0.0, 0.0, rise))
            parts += [ShapePart(geom, kind, name) for geom in shapes.objects[name].geoms]
            there.append(shapes.objects[name].at(pose.position[None], pose.rotation[None]))
    return Arrangement.of(shapes, parts, Frames.concatenate(there))
