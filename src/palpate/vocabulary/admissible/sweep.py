"""Sweep: minimum distances of the arm, the hand and the held object along a path.

A path is sampled at moments. Between two of them no point of a shape travels farther than its
middle plus its radius times the turn; so two shapes that are farther apart at both moments than what
they travel do not meet in between. Bounding boxes rule out nearly all pairs, for all moments
together; the others are measured exactly, and the interval is halved until they are clear or hit
(conservative advancement).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from palpate.geometry.pose import Array
from palpate.vocabulary.admissible.arrangement import Arrangement, Part
from palpate.vocabulary.admissible.path import ArmPath
from palpate.vocabulary.admissible.solids import Frames, Solids

FINEST = 0.002  # m of travel below which an interval is not halved again
SLACK = 0.001
"""m by which a pair that is too near at the start may come nearer: the tracking error of the arm."""
CURVED = 1.02
"""Arc length of a shape between two moments over its chord: no joint turns by more than 0.1 rad."""
Pairs = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Hit:
    """Two parts that come too near each other.

    Attributes:
        distance: m, negative where they overlap.
        where: (3,) m, world.
        share: of the path, from 0 to 1.
    """

    part: Part
    other: Part
    distance: float
    where: tuple[float, float, float]
    share: float

    @property
    def place(self) -> str:
        """Place of the contact, in words."""
        x, y, z = self.where
        return f"({x:.3f}, {y:.3f}, {z:.3f}) m"


@dataclass(eq=False)
class Moment:
    """The moving shapes at one moment.

    Attributes:
        at: number of the moment; a fraction between two of the path.
        frames: their poses.
        distances: m, measured so far, by the number of the pair.
    """

    at: float
    frames: Frames
    distances: dict[int, float] = field(default_factory=dict[int, float])


@dataclass(frozen=True, eq=False)
class Sweep:
    """A path with all that moves along it, among all that stands still.

    Attributes:
        solids: the shapes of the scene.
        path: the path.
        moving: the m moving parts.
        place: frames of the moving parts along a path.
        still: the k parts that stand still.
        meets: (m, k) mask of the moving and static parts that could meet at all.
        own: (p, 2) numbers of the moving parts that could meet each other.
        growth: m, the largest distance that matters: only pairs that may come as near are looked at.
        forth: the sweep of the path in the other direction, of which this is the way back.
    """

    solids: Solids
    path: ArmPath
    moving: Sequence[Part]
    place: Callable[[ArmPath], Frames]
    still: Arrangement
    meets: NDArray[np.bool_]
    own: Pairs
    growth: float
    forth: Sweep | None = None

    def back(self) -> Sweep:
        """The sweep of the way back, which shares all distances with this one."""
        return replace(self, path=self.path.reversed(), forth=self)

    @cached_property
    def frames(self) -> Frames:
        """Frames of the moving parts along the path."""
        return self.place(self.path)

    @property
    def pairs(self) -> Pairs:
        """(p, 2) numbers of the parts that may come within `growth`, a moving one first; the static
        ones are numbered after the moving ones. Pairs of two moving parts come last."""
        return self._near[0]

    @property
    def bounds(self) -> Array:
        """(n, p) m, lower bounds of the distances of pairs: from the bounding sphere of the first to
        the bounding box of the second."""
        return self._near[1]

    @property
    def travels(self) -> Array:
        """(n - 1, p) m, upper bounds of the relative travel of pairs between two moments."""
        return self._near[2]

    @cached_property
    def _near(self) -> tuple[Pairs, Array, Array]:
        """Pairs, bounds and travels, found in two stages: by the boxes of each moving part's whole path,
        then by what lies between each two moments."""
        if self.forth is not None:
            pairs, bounds, travels = self.forth._near
            return pairs, bounds[::-1], travels[::-1]
        positions = self.frames.positions
        steps = self._travel(positions, self.frames.rotations)
        # Between two moments a part is no farther from both than half of its travel.
        reach = (self.growth + self._radii + steps.max(axis=0) / 2)[:, None]
        near = self.still.near(positions.min(axis=0) - reach, positions.max(axis=0) + reach)
        static = np.argwhere(near & self.meets) + np.array([0, len(self.moving)])
        pairs = np.concatenate([static, self._near_own(steps)])
        bounds, travels = self._bounds(pairs), self._relative(pairs, steps)
        may = self._doubtful(bounds, travels, self.growth).any(axis=0)
        return pairs[may], bounds[:, may], travels[:, may]

    def _near_own(self, steps: Array) -> Pairs:
        """Pairs of `own` whose bounding spheres come near each other."""
        first, second = self.own.T
        apart = self.frames.positions[:, first] - self.frames.positions[:, second]
        bounds = np.sqrt((apart**2).sum(axis=2)) - self._radii[first] - self._radii[second]
        travels = self._relative(self.own, steps)
        return self.own[self._doubtful(bounds, travels, self.growth).any(axis=0)]

    @staticmethod
    def _doubtful(bounds: Array, travels: Array, margins: Array | float) -> NDArray[np.bool_]:
        """(n - 1, p) mask of the intervals in which pairs may come nearer than their margins: the least
        distance between two moments is at least half of both distances less the travel."""
        return (bounds[:-1] + bounds[1:] - travels) / 2 < margins

    def of(self, pair: int) -> tuple[Part, Part]:
        """The parts of a pair."""
        (i, j), m = self._numbers[pair], len(self.moving)
        return self.moving[i], self.still.parts[j - m] if j >= m else self.moving[j]

    def hits(self, margins: Array) -> Iterator[Hit]:
        """Pairs that come nearer than their margin (p,), m, each where it first does.

        A pair that is too near at the start may stay as near.
        """
        for found in self._hits_by_interval(margins):
            yield from found

    def first(self, margins: Array) -> Hit | None:
        """Earliest of the `hits`; the path behind it is not searched."""
        for found in self._hits_by_interval(margins):
            return min(found, key=lambda hit: hit.share)
        return None

    def overlaps(self) -> Iterator[Hit]:
        """Pairs that overlap at the start."""
        start = self._moment(0)
        for pair in np.flatnonzero(self.bounds[0] < 0.0).tolist():
            if self._distance(start, pair) < 0.0:
                yield self._hit(pair, start)

    def near(self, growth: float) -> NDArray[np.bool_]:
        """(n - 1,) mask of the intervals in which any pair may come within `growth` m."""
        doubtful = self._doubtful(self.bounds, self.travels, growth)
        found = np.zeros(len(doubtful), dtype=np.bool_)
        for i in range(len(doubtful)):
            start, end = self._moment(i), self._moment(i + 1)
            for pair in np.flatnonzero(doubtful[i]).tolist():
                apart = self._distance(start, pair) + self._distance(end, pair)
                if (apart - self.travels[i, pair]) / 2 < growth:
                    found[i] = True
                    break
        return found

    def _bounds(self, pairs: Pairs) -> Array:
        first, second = pairs.T
        static = int((second >= len(self.moving)).sum())
        still, other = second[:static] - len(self.moving), second[static:]
        parts = [
            self._to_box(first[:static], self.still.frames, still, self.still.geoms[still]),
            self._to_box(first[static:], self.frames, other, self._geoms[other]),
        ]
        return np.concatenate(parts, axis=1) - self._radii[first]

    @cached_property
    def _geoms(self) -> Pairs:
        return np.array([part.geom for part in self.moving])

    @cached_property
    def _radii(self) -> Array:
        return self.solids.radii[self._geoms]

    @cached_property
    def _numbers(self) -> list[tuple[int, int]]:
        return [(i, j) for i, j in self.pairs.tolist()]

    @cached_property
    def _moments(self) -> dict[int, Moment]:
        return {}

    def _moment(self, i: int) -> Moment:
        if self.forth is not None:
            same = self.forth._moment(self.path.count - 1 - i)
            return Moment(float(i), same.frames, same.distances)
        if i not in self._moments:
            self._moments[i] = Moment(float(i), self.frames.at(i))
        return self._moments[i]

    def _to_box(self, first: Pairs, frames: Frames, second: Pairs, geoms: Pairs) -> Array:
        """(n, p) m from the centres of moving parts to the bounding boxes of the parts `second` of
        `frames`, at as many moments or at a single one."""
        boxes, (middle, half) = frames.positions[:, second], self.solids.boxes
        apart = self.frames.positions[:, first] - boxes
        # In the axes of the box: R^T d, by its columns.
        beside = np.einsum("nkij,nki->nkj", frames.rotations[:, second], apart)
        outside = np.maximum(np.abs(beside - middle[geoms]) - half[geoms], 0.0)
        return np.sqrt((outside**2).sum(axis=2))

    def _hits_by_interval(self, margins: Array) -> Iterator[list[Hit]]:
        """Hits of each interval that has any, in the order of the path."""
        margins = margins.copy()
        for pair in np.flatnonzero(self.bounds[0] < margins).tolist():
            margins[pair] = min(margins[pair], self._distance(self._moment(0), pair) - SLACK)
        doubtful = self._doubtful(self.bounds, self.travels, margins)
        met: set[int] = set()
        for i in np.flatnonzero(doubtful.any(axis=1)).tolist():
            found: list[Hit] = []
            left = [p for p in np.flatnonzero(doubtful[i]).tolist() if p not in met]
            for pair, moment in self._search(self._moment(i), self._moment(i + 1), left, margins):
                if pair not in met:
                    met.add(pair)
                    found.append(self._hit(pair, moment))
            if found:
                yield found

    def _search(
        self, low: Moment, high: Moment, pairs: list[int], margins: Array
    ) -> Iterator[tuple[int, Moment]]:
        """Pairs that come too near between two moments, with the moment; by bisection."""
        steps = self._travel(
            np.concatenate([low.frames.positions, high.frames.positions]),
            np.concatenate([low.frames.rotations, high.frames.rotations]),
        )
        travels = self._relative(self.pairs[pairs], steps)[0].tolist()
        open_pairs: list[int] = []
        for pair, travel in zip(pairs, travels, strict=True):
            before, after = self._distance(low, pair), self._distance(high, pair)
            if min(before, after) < margins[pair]:
                yield pair, low if before < margins[pair] else high
            # The least distance in between is at least (before + after - travel) / 2.
            elif (before + after - travel) / 2 < margins[pair] and travel > FINEST:
                open_pairs.append(pair)
        if open_pairs:
            at = (low.at + high.at) / 2
            middle = Moment(at, self.place(self.path.between(at)))
            yield from self._search(low, middle, open_pairs, margins)
            yield from self._search(middle, high, open_pairs, margins)

    def _travel(self, positions: Array, rotations: Array) -> Array:
        """(n - 1, m) m, upper bound of the travel of any point of a shape between two moments."""
        shift = positions[1:] - positions[:-1]
        moved = np.sqrt(np.einsum("nki,nki->nk", shift, shift))
        # The Frobenius norm of a change of rotation is √2 times the chord of its angle.
        change = (rotations[1:] - rotations[:-1]).reshape(*moved.shape, 9)
        turned = np.sqrt(np.einsum("nki,nki->nk", change, change) / 2)
        return CURVED * (moved + self._radii * turned)

    def _relative(self, pairs: Pairs, travels: Array) -> Array:
        """(n - 1, p) m, travel of both parts of each pair together; static ones do not move."""
        first, second = pairs.T
        own = second < len(self.moving)
        both = travels[:, first]
        both[:, own] += travels[:, second[own]]
        return both

    def _distance(self, moment: Moment, pair: int) -> float:
        if pair not in moment.distances:
            i, j = self._numbers[pair]
            first, second = self.of(pair)
            there, number = moment.frames, j
            if j >= len(self.moving):
                there, number = self.still.frames, j - len(self.moving)
            moment.distances[pair] = self.solids.distance(
                first.geom, moment.frames, i, second.geom, there, number
            )
        return moment.distances[pair]

    def _hit(self, pair: int, moment: Moment) -> Hit:
        # Measured again: `between` belongs to the last distance.
        moment.distances.pop(pair, None)
        distance = self._distance(moment, pair)
        x, y, z = self.solids.between().tolist()
        part, other = self.of(pair)
        share = moment.at / (self.path.count - 1)
        return Hit(part, other, distance, (x, y, z), share)
