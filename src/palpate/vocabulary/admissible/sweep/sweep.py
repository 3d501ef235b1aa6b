"""A way and all that may meet along it; which pairs do, and where."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from palpate.geometry.pose import Array
from palpate.vocabulary.admissible.solids import Solids
from palpate.vocabulary.admissible.sweep.frames import Frames
from palpate.vocabulary.admissible.sweep.way import Way

FINEST = 0.002
"""m: a stretch on which nothing travels farther is not halved again."""
SLACK = 0.001
"""m that what is near at the start may come nearer: joints and lines are followed to that."""
CURVED = 1.02
"""Arc length of a shape between two moments over its chord: no joint turns by more than 0.1 rad."""
Pairs = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A moving or standing shape.

    Attributes:
        geom: its number in the compiled scene.
        kind: `hand`, `load`, a finger's side, `link`; else empty.
        owner: the body that it is part of.
    """

    geom: int
    kind: str
    owner: str


@dataclass(frozen=True, slots=True)
class Hit:
    """Two parts that come too near each other: which, by how much, where and when.

    Attributes:
        distance: m, negative where they overlap.
        where: (3,) m, world.
        share: of the way.
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
    """The shapes at one moment, and the distances of pairs measured there.

    Attributes:
        at: the number of the moment; between two of the way's own, a fraction.
        frames: of all parts.
        known: m, by the number of the pair.
    """

    at: float
    frames: Frames
    known: dict[int, float] = field(default_factory=dict[int, float])


@dataclass(frozen=True, eq=False)
class Sweep:
    """A way, with all that moves along it and all that stands beside it.

    Attributes:
        parts: what moves, then what stands.
        moving: how many of them move.
        place: the shapes' frames of a way, in the order of `parts`.
        frames: all shapes at all moments.
        pairs: (p, 2) which of them may meet; the first of each moves, and the second of the last
            ones.
    """

    solids: Solids
    way: Way
    parts: Sequence[Part]
    moving: int
    place: Callable[[Way], Frames]
    frames: Frames
    pairs: Pairs

    def within(self, growth: float) -> Sweep:
        """The same with those pairs alone that may come within `growth` m, by the boxes around all
        the places of what moves, and around what stands."""
        positions, turns = self.frames.positions, self.frames.rotations[0, self.moving :]
        low, high = positions[:, : self.moving].min(axis=0), positions[:, : self.moving].max(axis=0)
        # Between two moments it is no farther from both than half of its travel.
        travel = self._travel(positions, self.frames.rotations)[:, : self.moving].max(axis=0)
        reach = growth + self._moving_radii + travel / 2
        middles, halves = self.solids.boxes
        standing = self._geoms[self.moving :]
        middle = positions[0, self.moving :] + np.einsum("kij,kj->ki", turns, middles[standing])
        half = np.einsum("kij,kj->ki", np.abs(turns), halves[standing])
        before, behind = middle - half - high[:, None], low[:, None] - middle - half
        near = np.maximum(before, behind).max(axis=2) < reach[:, None]
        both_move = np.ones((self.moving, self.moving), dtype=np.bool_)
        may_meet = np.concatenate([both_move, near], axis=1)
        return replace(self, pairs=self.pairs[may_meet[self.pairs[:, 0], self.pairs[:, 1]]])

    @cached_property
    def bounds(self) -> Array:
        """(n, p) m that the shapes of a pair are apart at least, by the ball around one and the box
        around the other."""
        to_standing = int((self.pairs[:, 1] >= self.moving).sum())
        standing, moving = self.pairs[:to_standing], self.pairs[to_standing:]
        # What stands is at the first moment where it always is.
        parts = [self._apart(standing, slice(0, 1)), self._apart(moving, slice(None))]
        return np.concatenate(parts, axis=1) - self.solids.radii[self._geoms[self.pairs[:, 0]]]

    @cached_property
    def travels(self) -> Array:
        """(n - 1, p) m that the shapes of a pair travel against each other at most, between two
        moments."""
        each = self._travel(self.frames.positions, self.frames.rotations)
        return each[:, self.pairs[:, 0]] + each[:, self.pairs[:, 1]]

    @cached_property
    def _geoms(self) -> Pairs:
        return np.array([part.geom for part in self.parts])

    @cached_property
    def _moving_radii(self) -> Array:
        return self.solids.radii[self._geoms[: self.moving]]

    @cached_property
    def _moments(self) -> dict[int, Moment]:
        return {}

    def _moment(self, i: int) -> Moment:
        """A moment of the way."""
        if i not in self._moments:
            self._moments[i] = Moment(float(i), self.frames.at(i))
        return self._moments[i]

    def _apart(self, pairs: Pairs, moments: slice) -> Array:
        """(n, p) m from the middle of the first of each pair to the box around the second, which is
        looked at in these moments alone."""
        first, second = pairs[:, 0], pairs[:, 1]
        middles, halves = self.solids.boxes
        middle, half = middles[self._geoms[second]], halves[self._geoms[second]]
        x, y, z = (
            self.frames.positions[:, first, axis] - self.frames.positions[moments, second, axis]
            for axis in range(3)
        )
        turns, total = self.frames.rotations[moments, second], np.zeros(x.shape)
        for axis in range(3):
            turn = turns[:, :, :, axis]
            outside = x * turn[:, :, 0] + y * turn[:, :, 1] + z * turn[:, :, 2]
            outside = np.abs(outside - middle[:, axis]) - half[:, axis]
            total += np.maximum(outside, 0.0) ** 2
        return np.sqrt(total)

    def hits(self, margins: Array) -> Iterator[Hit]:
        """Pairs that come nearer than their margin (p,) m, each where it first does.

        What is too near at the start may stay as near.
        """
        for found in self._hits_in_turn(margins):
            yield from found

    def first(self, margins: Array) -> Hit | None:
        """The first of the `hits`; what comes after it is not looked for."""
        for found in self._hits_in_turn(margins):
            return min(found, key=lambda hit: hit.share)
        return None

    def _hits_in_turn(self, margins: Array) -> Iterator[list[Hit]]:
        """The hits between one moment and the next, where there are any."""
        margins = self._as_at_start(margins)
        apart = (self.bounds[:-1] + self.bounds[1:] - self.travels) / 2
        doubtful = apart < margins
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

    def overlaps(self) -> Iterator[Hit]:
        """Pairs that are inside each other at the start."""
        start = self._moment(0)
        for pair in np.flatnonzero(self.bounds[0] < 0.0).tolist():
            if self._exact(start, pair) < 0.0:
                yield self._hit(pair, start)

    def near(self, growth: float) -> NDArray[np.bool_]:
        """(n - 1,) bool: whether any pair may come within `growth` m between two moments."""
        doubtful = (self.bounds[:-1] + self.bounds[1:] - self.travels) / 2 < growth
        found = np.zeros(len(doubtful), dtype=np.bool_)
        for i in range(len(doubtful)):
            for pair in np.flatnonzero(doubtful[i]).tolist():
                apart = self._exact(self._moment(i), pair) + self._exact(self._moment(i + 1), pair)
                if (apart - self.travels[i, pair]) / 2 < growth:
                    found[i] = True
                    break
        return found

    def _as_at_start(self, margins: Array) -> Array:
        allowed = margins.copy()
        for pair in np.flatnonzero(self.bounds[0] < margins).tolist():
            allowed[pair] = min(margins[pair], self._exact(self._moment(0), pair) - SLACK)
        return allowed

    def _search(
        self, low: Moment, high: Moment, pairs: list[int], margins: Array
    ) -> Iterator[tuple[int, Moment]]:
        """Pairs that come too near between two moments, with the time."""
        travels = self._travel(
            np.concatenate([low.frames.positions, high.frames.positions]),
            np.concatenate([low.frames.rotations, high.frames.rotations]),
        )[0]
        open_pairs: list[int] = []
        for pair in pairs:
            before, after = self._exact(low, pair), self._exact(high, pair)
            travel = travels[self.pairs[pair, 0]] + travels[self.pairs[pair, 1]]
            if min(before, after) < margins[pair]:
                yield pair, low if before < margins[pair] else high
            elif (before + after - travel) / 2 < margins[pair] and travel > FINEST:
                open_pairs.append(pair)
        if open_pairs:
            at = (low.at + high.at) / 2
            middle = Moment(at, self.place(self.way.between(at)))
            yield from self._search(low, middle, open_pairs, margins)
            yield from self._search(middle, high, open_pairs, margins)

    def _travel(self, positions: Array, rotations: Array) -> Array:
        """(n - 1, k) m that any point of a shape moves at most between two moments."""
        travels = np.zeros((len(positions) - 1, len(self.parts)))
        positions, rotations = positions[:, : self.moving], rotations[:, : self.moving]
        moved = np.sqrt(((positions[1:] - positions[:-1]) ** 2).sum(axis=2))
        turned = np.sqrt(((rotations[1:] - rotations[:-1]) ** 2).sum(axis=(2, 3)) / 2)
        travels[:, : self.moving] = CURVED * (moved + self._moving_radii * turned)
        return travels

    def _exact(self, moment: Moment, pair: int) -> float:
        if pair not in moment.known:
            moment.known[pair] = self._measure(moment, pair)
        return moment.known[pair]

    def _measure(self, moment: Moment, pair: int) -> float:
        i, j = map(int, self.pairs[pair])
        return self.solids.distance(self.parts[i].geom, self.parts[j].geom, moment.frames, i, j)

    def _hit(self, pair: int, moment: Moment) -> Hit:
        distance = self._measure(moment, pair)
        x, y, z = self.solids.between().tolist()
        i, j = map(int, self.pairs[pair])
        share = moment.at / (self.way.count - 1)
        return Hit(self.parts[i], self.parts[j], distance, (x, y, z), share)
