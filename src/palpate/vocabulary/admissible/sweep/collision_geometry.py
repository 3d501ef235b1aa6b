"""Collision geometry of a sweep: moving with the hand, moving with the arm's links, and static."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.geometry.pose import Pose
from palpate.vocabulary.admissible.grip import grip
from palpate.vocabulary.admissible.solids import SIDES, Solids, solids
from palpate.vocabulary.admissible.sweep.frames import Cluster, Frames, Shape
from palpate.vocabulary.admissible.sweep.sweep import Part, Sweep
from palpate.vocabulary.admissible.sweep.way import Way, of_hand
from palpate.vocabulary.state import SymbolicState

HAND = "hand"
LOAD = "load"
LINK = "link"
HIGHER = "higher"
"""Kinds of parts, beside the two fingers; the last is of what stands on a surface of unknown height, as
high as it may be."""
NOTHING: Mapping[str, float] = {}
NEIGHBOURS = 2
"""Joints: parts of the arm with no more of them between cannot, or always nearly, touch."""
SPACING = 0.01
"""m between two moments of `near_spans`."""


def hand_sweep(state: SymbolicState, way: Way) -> Sweep:
    """The hand, its fingers and the load along a way, among everything that is not held."""
    return CollisionGeometry.of(state).sweep(way)


def arm_sweep(state: SymbolicState, way: Way, higher: Mapping[str, float] = NOTHING) -> Sweep:
    """The whole arm with hand and load along a way that says how it is bent, among everything that
    is not held and its own links; some objects may be `higher` by so many m."""
    return CollisionGeometry.of(state, higher).sweep(way, with_links=True)


def near_spans(
    state: SymbolicState, start: Pose, end: Pose, growth: float
) -> tuple[tuple[float, float], ...]:
    """Shares (first, last) of the straight way from `start` to `end` of the TCP, world, on which
    the hand, the fingers or the load may come within `growth` m of anything; in order, apart from
    each other."""
    way = of_hand(start, end, opening(state), SPACING)
    near = hand_sweep(state, way).within(growth).near(growth)
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
class CollisionGeometry:
    """Collision geometry: moving with the hand, moving with the arm's links, and static."""

    solids: Solids
    carried: tuple[tuple[Part, Shape], ...]
    links: tuple[tuple[Part, int], ...]
    standing: tuple[Part, ...]
    there: Frames

    @classmethod
    def of(cls, state: SymbolicState, higher: Mapping[str, float] = NOTHING) -> CollisionGeometry:
        """Everything, as it is in a state."""
        shapes = solids(state.scene)
        links = [(Part(g, LINK, shapes.owners[g]), joint) for g, joint in shapes.links.items()]
        key = ("standing", state.holding, *state.placed, *sorted(higher.items()))
        standing, there = shapes.remembered(key, lambda: _standing(shapes, state, higher))
        return cls(shapes, tuple(_carried(shapes, state)), tuple(links), standing, there)

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
            key = ("own pairs", len(carried))
            own = self.solids.remembered(key, lambda: list(self._own_pairs()))
            pairs = np.concatenate([pairs, np.array(own, dtype=np.intp).reshape(-1, 2)])
        place, parts = self._placing(with_links), (*carried, *links, *self.standing)
        return Sweep(self.solids, way, parts, moving, place, place(way), pairs)

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


def _standing(
    shapes: Solids, state: SymbolicState, higher: Mapping[str, float]
) -> tuple[tuple[Part, ...], Frames]:
    """Static geometry with its poses."""
    standing = [Part(shape.geom, "", shapes.owners[shape.geom]) for shape in shapes.fixed]
    there = [shapes.standing]
    for name in state.scene.objects:
        if name == state.holding:
            continue
        cluster = shapes.clusters[name]
        for kind, rise in (("", 0.0), (HIGHER, higher.get(name, 0.0))):
            if kind and not rise:
                continue
            pose = state.pose_of(name).translated((0.0, 0.0, rise))
            standing += [Part(shape.geom, kind, name) for shape in shapes.objects[name]]
            there.append(cluster.at(pose.position[None], pose.rotation[None]))
    return tuple(standing), Frames.joined(there)


def _carried(shapes: Solids, state: SymbolicState) -> Iterator[tuple[Part, Shape]]:
    """The hand, its fingers and what it holds, in the tool's frame."""
    for shape in shapes.hand:
        yield Part(shape.geom, HAND, HAND), shape
    for side, finger in shapes.fingers.items():
        for shape in finger:
            yield Part(shape.geom, side, side), shape
    if state.holding is not None and state.pose_tcp_object is not None:
        for shape in shapes.objects[state.holding]:
            held = _within(state.pose_tcp_object, shape)
            yield Part(shape.geom, LOAD, state.holding), held


def _within(carrier: Pose, shape: Shape) -> Shape:
    """A shape of something whose frame is at a pose, in the frame of that pose."""
    return Shape(shape.geom, carrier.apply(shape.position), carrier.rotation @ shape.rotation)
