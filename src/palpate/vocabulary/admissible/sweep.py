"""What a motion of the arm, the hand and what it holds comes near, and where.

The way is looked at in moments. Between two of them no shape travels farther than its middle plus
its radius times the turn; so where two shapes are farther apart at both than what they travel, they
do not meet between them. Boxes rule out nearly all pairs, for all moments at once; what is left is
measured exactly, and halved until it is clear or found out (conservative advancement).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from palpate.geometry.pose import Array, Pose
from palpate.vocabulary.admissible.frames import Cluster, Frames, Shape
from palpate.vocabulary.admissible.grip import grip
from palpate.vocabulary.admissible.solids import SIDES, Solids, solids
from palpate.vocabulary.admissible.way import Way, of_hand
from palpate.vocabulary.state import SymbolicState

HAND, LOAD, LINK = "hand", "load", "link"
NEIGHBOURS = 2
"""Joints: parts of the arm with no more of them between cannot, or always nearly, touch."""
SLACK = 0.001
"""m that what is near at the start may come nearer: joints and lines are followed to that."""
FINEST = 0.002
"""m: a stretch on which nothing travels farther is not halved again."""
CURVED = 1.02
"""What a shape travels between two moments, over its chord: no joint turns by more than 0.1 rad."""
SPACING = 0.01
"""m between two moments of `near_spans`."""

Pairs = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A moving or standing shape. `kind`: `hand`, `load`, a finger, a link; else empty."""

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


@dataclass(eq=False)
class Moment:
    """The shapes at one moment, and the distances of pairs measured there."""

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
        pairs: (p, 2) which of them may meet; the first of each moves, and the second of the last
            ones.
    """

    solids: Solids
    way: Way
    parts: Sequence[Part]
    moving: int
    place: Callable[[Way], Frames]
    pairs: Pairs

    @cached_property
    def frames(self) -> Frames:
        """All shapes at all moments."""
        return self.place(self.way)

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
        """Which of the pairs come too near between two moments, and when."""
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


def hand_sweep(state: SymbolicState, way: Way) -> Sweep:
    """The hand, its fingers and the load along a way, among everything that is not held."""
    return _Crowd.of(state).sweep(way)


def arm_sweep(state: SymbolicState, way: Way) -> Sweep:
    """The whole arm with hand and load along a way that says how it is bent, among everything that
    is not held and its own links."""
    return _Crowd.of(state).sweep(way, with_links=True)


def near_spans(
    state: SymbolicState, start: Pose, end: Pose, growth: float
) -> tuple[tuple[float, float], ...]:
    """Shares (first, last) of the straight way from `start` to `end` of the TCP, world, on which
    the hand, the fingers or the load may come within `growth` m of anything; in order, apart from
    each other."""
    way = of_hand(start, end, opening(state), SPACING)
    near = hand_sweep(state, way).near(growth)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], near.astype(int), [0]])))
    spans: list[tuple[float, float]] = []
    for first, last in edges.reshape(-1, 2).tolist():
        spans.append((first / len(near), last / len(near)))
    return tuple(spans)


def opening(state: SymbolicState) -> float:
    """m between the fingers, as believed: open where nothing is known."""
    if state.holding is not None and state.pose_tcp_object is not None:
        held = grip(solids(state.scene), state.holding, state.pose_tcp_object)
        return held.width if held is not None else 0.0
    return 0.0 if state.gripper == "closed" else state.scene.arm.hand.opening


@dataclass(frozen=True, slots=True, eq=False)
class _Crowd:
    """What moves with the hand, what bends with the arm, and what stands."""

    solids: Solids
    carried: tuple[tuple[Part, Shape], ...]
    links: tuple[tuple[Part, int], ...]
    standing: tuple[Part, ...]
    there: Frames

    @classmethod
    def of(cls, state: SymbolicState) -> _Crowd:
        """Everything, as it is in a state."""
        shapes = solids(state.scene)
        carried = [(Part(shape.geom, HAND, HAND), shape) for shape in shapes.hand]
        for side, finger in shapes.fingers.items():
            carried += [(Part(shape.geom, side, side), shape) for shape in finger]
        if state.holding is not None and state.pose_tcp_object is not None:
            for shape in shapes.objects[state.holding]:
                held = _within(state.pose_tcp_object, shape)
                carried.append((Part(shape.geom, LOAD, state.holding), held))
        links: list[tuple[Part, int]] = []
        for geom, joint in shapes.links.items():
            links.append((Part(geom, LINK, shapes.owners[geom]), joint))
        standing = [Part(shape.geom, "", shapes.owners[shape.geom]) for shape in shapes.fixed]
        there = [shapes.standing]
        for name in state.scene.objects:
            if name != state.holding:
                pose, cluster = state.pose_of(name), shapes.clusters[name]
                standing += [Part(shape.geom, "", name) for shape in shapes.objects[name]]
                there.append(cluster.at(pose.position[None], pose.rotation[None]))
        return cls(shapes, tuple(carried), tuple(links), tuple(standing), Frames.joined(there))

    def sweep(self, way: Way, with_links: bool = False) -> Sweep:
        """Of a way, by the hand or by the whole arm."""
        carried = [part for part, _ in self.carried]
        links = [part for part, _ in self.links] if with_links else []
        moving = len(carried) + len(links)
        meets = np.ones((moving, len(self.standing)), dtype=np.bool_)
        if with_links:
            meets[len(carried) :] = self._links_meet()
        pairs = np.argwhere(meets) + np.array([0, moving])
        if with_links:
            own = np.array(list(self._own_pairs()), dtype=np.intp).reshape(-1, 2)
            pairs = np.concatenate([pairs, own])
        return Sweep(
            self.solids,
            way,
            (*carried, *links, *self.standing),
            moving,
            self._placing(with_links),
            pairs,
        )

    def _links_meet(self) -> NDArray[np.bool_]:
        """(links, standing) whether they can, or are neighbours: the base and the first links."""
        based = np.array([part.owner == self.solids.base for part in self.standing], dtype=np.bool_)
        near = np.array([joint <= NEIGHBOURS for _, joint in self.links], dtype=np.bool_)
        return ~(near[:, None] & based)

    def _own_pairs(self) -> Iterator[tuple[int, int]]:
        """Parts of the robot that can meet: those with enough joints between them."""
        first = len(self.carried)
        last_joint = len(self.solids.scene.arm.joints)
        for i, (_, joint) in enumerate(self.links):
            for carried in range(len(self.carried)):
                if last_joint - joint >= NEIGHBOURS:
                    yield carried, first + i
            for j, (_, other) in enumerate(self.links[:i]):
                if joint - other > NEIGHBOURS:
                    yield first + i, first + j

    def _placing(self, with_links: bool) -> Callable[[Way], Frames]:
        carried = Cluster.of([shape for _, shape in self.carried])
        sides = np.array([SIDES.get(part.kind, 0.0) for part, _ in self.carried]) / 2

        def place(way: Way) -> Frames:
            rotations = way.rotations()
            hand = carried.at(way.positions, rotations)
            # A finger is half the opening beside the tool's axis, along its y.
            beside = np.einsum("n,k,nj->nkj", way.widths, sides, rotations[:, :, 1])
            parts = [Frames(hand.positions + beside, hand.rotations)]
            if with_links:
                assert way.q is not None
                parts.append(self.solids.links_at(way.q))
            return Frames.joined([*parts, self.there.repeated(way.count)])

        return place


def _within(carrier: Pose, shape: Shape) -> Shape:
    """A shape of something whose frame is at a pose, in the frame of that pose."""
    return Shape(shape.geom, carrier.apply(shape.position), carrier.rotation @ shape.rotation)
