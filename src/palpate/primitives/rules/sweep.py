"""Sweep: minimum distances of the arm, the hand and the held object along a path.

A path is sampled at moments. Between two moments, a point of a shape travels at most the travel of
the shape's middle plus its radius times the turn. With the relative travel s and the distances
d0 and d1 at both moments, d >= (d0 + d1 - s) / 2 holds in between.

Bounding boxes rule out nearly all pairs, for all moments together. The other pairs are measured
exactly. Their intervals are halved until the pair is clear or hits (conservative advancement). All
intervals of a path are halved together.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array, Frames
from palpate.primitives.rules.arrangement import Arrangement, ShapePart
from palpate.primitives.rules.clearance import ArmPath
from palpate.primitives.rules.solids import Solids

FINEST = 0.002  # m of travel below which an interval is not halved again
# m. A pair that is too near at the start may come nearer by this tracking error of the arm.
SLACK = 0.001
# Upper bound of arc length over chord, for a shape between two moments. No joint turns by more than
# 0.1 rad between two moments.
CURVED = 1.02
Pairs = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Hit:
    """Two parts that come too near each other."""

    part: ShapePart
    other: ShapePart
    distance: float  # m, negative where they overlap
    where: tuple[float, float, float]  # (3,) m, world
    share: float  # of the path, from 0 to 1

    @property
    def place(self) -> str:
        """Place of the contact, in words."""
        x, y, z = (round(value, 3) + 0.0 for value in self.where)  # no negative zero
        return f"({x:.3f}, {y:.3f}, {z:.3f}) m"


@dataclass(eq=False)
class Moment:
    """The moving shapes at one moment."""

    at: float  # number of the moment; a fraction between two of the path
    frames: Frames  # their poses
    # m, measured so far, by the number of the pair.
    distances: dict[int, float] = field(default_factory=dict[int, float])


class SweepInterval(NamedTuple):
    """Two moments, and the pairs that may come too near in between with their travel, m."""

    low: Moment
    high: Moment
    pairs: list[int]
    travels: list[float]


class Met(NamedTuple):
    """A pair that is too near at a moment; ordered by the interval's beginning, the wider one first."""

    begins: float
    halvings: int
    pair: int
    moment: Moment


@dataclass(frozen=True, eq=False)
class Sweep:
    """Moving shapes along a path, among static shapes."""

    solids: Solids  # the shapes of the scene
    path: ArmPath  # the path
    moving: Sequence[ShapePart]  # the m moving parts
    place: Callable[[ArmPath], Frames]  # frames of the moving parts along a path
    still: Arrangement  # the k static parts
    # (m, m + k) mask of the moving parts that could meet each of all parts.
    meets: NDArray[np.bool_]
    # m, the largest distance that matters. Pairs that stay farther apart are left out.
    growth: float
    # The sweep of the opposite direction, whose distances this one reuses.
    forth: Sweep | None = None

    def back(self) -> Sweep:
        """The sweep of the way back, which shares all distances with this one."""
        return replace(self, path=self.path.reverse(), forth=self)

    @cached_property
    def frames(self) -> Frames:
        """Frames of the moving parts along the path."""
        return self.place(self.path)

    @property
    def pairs(self) -> Pairs:
        """(p, 2) numbers of the parts that may come within `growth`, a moving part first.

        Static parts are numbered after the moving ones. Pairs of two moving parts come last.
        """
        return self._near[0]

    @property
    def bounds(self) -> Array:
        """(n, p) m, lower bounds of the distances of pairs.

        The bound is the distance from the first part's bounding sphere to the second's bounding box.
        """
        return self._near[1]

    @property
    def travels(self) -> Array:
        """(n - 1, p) m, upper bounds of the relative travel of pairs between two moments."""
        return self._near[2]

    @cached_property
    def _near(self) -> tuple[Pairs, Array, Array]:
        """Pairs (p, 2), bounds (n, p) and travels (n - 1, p).

        The first stage compares boxes around each part's whole path. The second stage bounds the
        distances in each interval.
        """
        if self.forth is not None:
            # The way back has the same pairs; bounds and travels are in reverse order.
            pairs, bounds, travels = self.forth._near
            return pairs, bounds[::-1], travels[::-1]
        positions = self.frames.positions
        # Axis-aligned boxes around the whole path of each moving part.
        steps = self._travel(self.frames.part(slice(-1)), self.frames.part(slice(1, None)))
        # Between two moments a part is no farther from both than half of its travel.
        reach = (self.growth + self._radii + steps.max(axis=0) / 2)[:, None]
        low, high = positions.min(axis=0) - reach, positions.max(axis=0) + reach
        # Pairs whose boxes overlap: among the moving parts, and with the static ones.
        own = (low <= high[:, None]).all(axis=2)
        near = np.concatenate([own & own.T, self.still.near(low, high)], axis=1)
        pairs = np.argwhere(near & self.meets)
        pairs = pairs[np.argsort(pairs[:, 1] < len(self.moving), kind="stable")]
        # Keep the pairs that may come within `growth` in at least one interval.
        bounds, travels = self._bounds(pairs), self._relative(pairs, steps)
        may = self._doubtful(bounds, travels, self.growth).any(axis=0)
        return pairs[may], bounds[:, may], travels[:, may]

    @staticmethod
    def _doubtful(bounds: Array, travels: Array, margins: Array | float) -> NDArray[np.bool_]:
        """(n - 1, p) mask of the intervals in which pairs may come nearer than their margins.

        With the distances d0 and d1 at both ends and the travel s, d >= (d0 + d1 - s) / 2.
        """
        return (bounds[:-1] + bounds[1:] - travels) / 2 < margins

    def of(self, pair: int) -> tuple[ShapePart, ShapePart]:
        """The parts of a pair."""
        _, i, _, j, still = self._numbers[pair]
        return self.moving[i], (self.still.parts if still else self.moving)[j]

    def hits(self, margins: Array) -> Iterator[Hit]:
        """Pairs that come nearer than their margin (p,), m, at the first moment; a near start may stay as near."""
        allowed = self._allowed_margins(margins)
        # Skip the search if the path was already clear with margins as large as these.
        if any((allowed <= kept).all() for kept in self._kept):
            return
        found = self._close_pairs(list(self._intervals(allowed)), allowed)
        if not found:
            self._kept.append(allowed)
        for met in found:
            yield self._hit(met.pair, met.moment)

    def first(self, margins: Array) -> Hit | None:
        """Earliest of the `hits`; the path behind it is not searched."""
        allowed = self._allowed_margins(margins)
        for interval in self._intervals(allowed):
            hits = [
                self._hit(met.pair, met.moment) for met in self._close_pairs([interval], allowed)
            ]
            if hits:
                return min(hits, key=lambda hit: hit.share)
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
            # Measure the doubtful pairs exactly at both ends of the interval.
            for pair in np.flatnonzero(doubtful[i]).tolist():
                apart = self._distance(start, pair) + self._distance(end, pair)
                if (apart - self.travels[i, pair]) / 2 < growth:
                    found[i] = True
                    break
        return found

    def _bounds(self, pairs: Pairs) -> Array:
        """(n, p) m, distance from each first part's bounding sphere to the second's bounding box."""
        first, second = pairs.T
        # Pairs with static parts come first in `pairs`, then pairs of two moving parts.
        static = int((second >= len(self.moving)).sum())
        still, other = second[:static] - len(self.moving), second[static:]
        bounds = self._to_box(first[:static], self.still.frames, still, self.still.geoms[still])
        if len(other):
            own = self._to_box(first[static:], self.frames, other, self._geoms[other])
            bounds = np.concatenate([bounds, own], axis=1)
        return bounds - self._radii[first]

    @cached_property
    def _geoms(self) -> Pairs:
        return np.array([part.geom for part in self.moving])

    @cached_property
    def _radii(self) -> Array:
        return self.solids.radii[self._geoms]

    @cached_property
    def _numbers(self) -> list[tuple[int, int, int, int, bool]]:
        """Geom and number of both parts of each pair, and true if the second part is static."""
        first, second = self.pairs.T
        still = second >= len(self.moving)
        number = second - len(self.moving) * still
        geoms = np.concatenate([self._geoms, self.still.geoms])[second]
        columns = (self._geoms[first], first, geoms, number, still)
        return list(zip(*(column.tolist() for column in columns), strict=True))

    @cached_property
    def _kept(self) -> list[Array]:
        """Margins (p,), m, that all pairs keep along the whole path, in either direction."""
        return [] if self.forth is None else self.forth._kept

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
        """(n, p) m, distances from the centres of moving parts to bounding boxes.

        The boxes are those of the parts `second` of `frames`, at n moments or at a single one.
        """
        boxes, (middle, half) = frames.positions[:, second], self.solids.boxes
        apart = self.frames.positions[:, first] - boxes
        # In the axes of the box: R^T d, by its columns.
        beside = np.einsum("nkij,nki->nkj", frames.rotations[:, second], apart)
        # Distance from a point to a box: the excess over the half extents, axis by axis.
        outside = np.maximum(np.abs(beside - middle[geoms]) - half[geoms], 0.0)
        return np.sqrt(np.einsum("nki,nki->nk", outside, outside))

    def _allowed_margins(self, margins: Array) -> Array:
        """(p,) m, margins, less for pairs that are too near at the start."""
        # A pair that starts too near may keep its distance, less `SLACK`.
        allowed, start = margins.copy(), self._moment(0)
        for pair in np.flatnonzero(self.bounds[0] < allowed).tolist():
            allowed[pair] = min(allowed[pair], self._distance(start, pair) - SLACK)
        return allowed

    def _intervals(self, margins: Array) -> Iterator[SweepInterval]:
        """Intervals in which pairs may come nearer than their margins (p,), m."""
        doubtful = self._doubtful(self.bounds, self.travels, margins)
        for i in np.flatnonzero(doubtful.any(axis=1)).tolist():
            pairs = np.flatnonzero(doubtful[i])
            travels = self.travels[i, pairs].tolist()
            yield SweepInterval(self._moment(i), self._moment(i + 1), pairs.tolist(), travels)

    def _close_pairs(self, level: list[SweepInterval], margins: Array) -> list[Met]:
        """Pairs that come too near in some intervals, at their first moments; level by level of halvings."""
        found, halvings = dict[int, Met](), 0
        while level:
            level = self._halve_intervals(self._unclear(level, margins, halvings, found))
            halvings += 1
        return sorted(found.values(), key=lambda met: met[:3])

    def _unclear(
        self, level: list[SweepInterval], margins: Array, halvings: int, found: dict[int, Met]
    ) -> Iterator[tuple[Moment, Moment, list[int]]]:
        """Intervals whose pairs may still come too near in between; those too near at an end go to `found`."""
        for low, high, pairs, travels in level:
            left: list[int] = []
            for pair, travel in zip(pairs, travels, strict=True):
                # An earlier contact of the pair is known: later intervals do not matter.
                if pair in found and found[pair].begins <= low.at:
                    continue
                before, after = self._distance(low, pair), self._distance(high, pair)
                if min(before, after) < margins[pair]:
                    there = low if before < margins[pair] else high
                    found[pair] = Met(low.at, halvings, pair, there)
                # The least distance in between is at least (before + after - travel) / 2.
                elif (before + after - travel) / 2 < margins[pair] and travel > FINEST:
                    left.append(pair)
            if left:
                yield low, high, left

    def _halve_intervals(
        self, open: Iterable[tuple[Moment, Moment, list[int]]]
    ) -> list[SweepInterval]:
        """Halves of intervals, all middles placed at once."""
        parts = list(open)
        if not parts:
            return []
        # Place the moving parts at the middles of all intervals in one call.
        at = np.array([(low.at + high.at) / 2 for low, high, _ in parts])
        frames = self.place(self.path.between(at))
        ends: list[tuple[Moment, Moment, list[int]]] = []
        for i, (low, high, pairs) in enumerate(parts):
            middle = Moment(float(at[i]), frames.at(i))
            ends += [(low, middle, pairs), (middle, high, pairs)]
        # Bound the relative travel of the pairs in each half.
        lows = Frames.concatenate_moments([low.frames for low, _, _ in ends])
        steps = self._travel(lows, Frames.concatenate_moments([high.frames for _, high, _ in ends]))
        travels = self._relative(self.pairs, steps)
        return [
            SweepInterval(low, high, pairs, travel[pairs].tolist())
            for (low, high, pairs), travel in zip(ends, travels, strict=True)
        ]

    def _travel(self, here: Frames, there: Frames) -> Array:
        """(n, m) m, upper bound of the travel of any point of a shape.

        |Δp| + r |ΔR|, times `CURVED`, between n moments `here` and the n next ones `there`.
        """
        shift = there.positions - here.positions
        moved = np.sqrt(np.einsum("nki,nki->nk", shift, shift))
        # The Frobenius norm of a change of rotation is √2 times the chord of its angle.
        change = (there.rotations - here.rotations).reshape(*moved.shape, 9)
        turned = np.sqrt(np.einsum("nki,nki->nk", change, change) / 2)
        return CURVED * (moved + self._radii * turned)

    def _relative(self, pairs: Pairs, travels: Array) -> Array:
        """(n - 1, p) m, sum of the travels of both parts of each pair; static parts do not move."""
        first, second = pairs.T
        own = second < len(self.moving)
        both = travels[:, first]
        both[:, own] += travels[:, second[own]]
        return both

    def _distance(self, moment: Moment, pair: int) -> float:
        found = moment.distances.get(pair)
        if found is None:
            first, i, second, j, still = self._numbers[pair]
            there = self.still.frames if still else moment.frames
            found = self.solids.distance(first, moment.frames, i, second, there, j)
            moment.distances[pair] = found
        return found

    def _hit(self, pair: int, moment: Moment) -> Hit:
        # Measured again: `between` belongs to the last distance.
        moment.distances.pop(pair, None)
        distance = self._distance(moment, pair)
        x, y, z = self.solids.between().tolist()
        part, other = self.of(pair)
        share = moment.at / (self.path.count - 1)
        return Hit(part, other, distance, (x, y, z), share)
