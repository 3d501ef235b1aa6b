"""Collision geometry of a sweep: the hand with its load, the arm's links, and everything static."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from palpate.geometry.pose import Pose
from palpate.vocabulary.admissible.grip import grip
from palpate.vocabulary.admissible.solids import SIDES, Frames, Shape, ShapeGroup, Solids, solids
from palpate.vocabulary.admissible.sweep import ArmPath, Pairs, Part, Sweep, hand_path
from palpate.vocabulary.state import SymbolicState

HAND = "hand"
LOAD = "load"
LINK = "link"
HIGHER = "higher"
"""Kinds of parts, besides the two fingers; the last is that of objects on a surface of unknown height,
as high as they may be."""
NEIGHBOURS = 2
"""Joints between two parts of the arm, up to which the parts cannot, or always nearly, touch."""
SPACING = 0.01  # m between two moments of `near_spans`


def hand_sweep(state: SymbolicState, path: ArmPath) -> Sweep:
    """Sweep of the hand, its fingers and the load, among everything that is not held."""
    return _sweep(state, path, {}, {})


def arm_sweep(
    state: SymbolicState, path: ArmPath, higher: Mapping[str, float] | None = None
) -> Sweep:
    """Sweep of the whole arm with hand and load along a path with joint angles, among everything
    that is not held and its own links; objects are also placed `higher` by so many m."""
    return _sweep(state, path, higher or {}, solids(state.scene).links)


def near_spans(
    state: SymbolicState, start: Pose, end: Pose, growth: float
) -> tuple[tuple[float, float], ...]:
    """Shares (first, last) of the TCP's straight path from `start` to `end` (world) on which the
    hand, the fingers or the load may come within `growth` m of anything; in order, disjoint."""
    path = hand_path(start, end, opening(state), SPACING)
    near = hand_sweep(state, path).within(growth).near(growth)
    # Edges of a mask: where it changes between False and True.
    edges = np.flatnonzero(np.diff(np.concatenate([[0], near.astype(int), [0]])))
    spans = (edges / len(near)).reshape(-1, 2).tolist()
    return tuple((first, last) for first, last in spans)


def opening(state: SymbolicState) -> float:
    """Believed opening of the fingers, m; open where nothing is known."""
    if state.holding is not None and state.pose_tcp_object is not None:
        held = grip(solids(state.scene), state.holding, state.pose_tcp_object)
        return held.width if held is not None else 0.0
    return 0.0 if state.gripper == "closed" else state.scene.arm.hand.opening


def _sweep(
    state: SymbolicState, path: ArmPath, higher: Mapping[str, float], joints: Mapping[int, int]
) -> Sweep:
    """`joints`: geom ids of the links to sweep as well, with the number of their joint."""
    shapes = solids(state.scene)
    carried = _carried(shapes, state)
    links = [Part(geom, LINK, shapes.owners[geom]) for geom in joints]
    key = ("static", state.holding, *state.placed, *sorted(higher.items()))
    static, there = shapes.cached(key, lambda: _static(shapes, state, higher))
    moving = len(carried) + len(links)

    meets = np.ones((moving, len(static)), dtype=np.bool_)
    # The base and the first links are neighbours.
    base = np.array([part.owner == state.scene.arm.base for part in static], dtype=np.bool_)
    first = np.array([joint <= NEIGHBOURS for joint in joints.values()], dtype=np.bool_)
    meets[len(carried) :] = ~(first[:, None] & base)
    key = ("own pairs", len(carried), len(links))
    own = shapes.cached(key, lambda: _own_pairs(list(joints.values()), len(carried), shapes))
    pairs = np.concatenate([np.argwhere(meets) + np.array([0, moving]), own])

    group = ShapeGroup.of([shape for _, shape in carried])
    sides = np.array([SIDES.get(part.kind, 0.0) for part, _ in carried]) / 2

    def place(path: ArmPath) -> Frames:
        rotations = path.rotations()
        hand = group.at(path.positions, rotations)
        # A finger is half the opening beside the tool's axis, along its y.
        beside = np.einsum("n,k,nj->nkj", path.widths, sides, rotations[:, :, 1])
        frames = [Frames(hand.positions + beside, hand.rotations)]
        if links:
            assert path.q is not None
            frames.append(shapes.links_at(path.q))
        return Frames.joined([*frames, there.repeated(path.count)])

    parts = (*(part for part, _ in carried), *links, *static)
    return Sweep(shapes, path, parts, moving, place=place, frames=place(path), pairs=pairs)


def _own_pairs(joints: list[int], carried: int, shapes: Solids) -> Pairs:
    """(p, 2) parts of the robot that can meet: those with enough joints between them."""
    last = len(shapes.scene.arm.joints)
    found: list[tuple[int, int]] = []
    for i, joint in enumerate(joints):
        if last - joint >= NEIGHBOURS:
            found += [(hand, carried + i) for hand in range(carried)]
        for j, other in enumerate(joints[:i]):
            if joint - other > NEIGHBOURS:
                found.append((carried + i, carried + j))
    return np.array(found, dtype=np.intp).reshape(-1, 2)


def _static(
    shapes: Solids, state: SymbolicState, higher: Mapping[str, float]
) -> tuple[tuple[Part, ...], Frames]:
    """Static parts with their poses."""
    parts = [Part(geom, "", shapes.owners[geom]) for geom in shapes.fixed.geoms]
    there = [shapes.standing]
    for name in state.scene.objects:
        if name == state.holding:
            continue
        for kind, rise in (("", 0.0), (HIGHER, higher.get(name, 0.0))):
            if kind and not rise:
                continue
            pose = state.pose_of(name).translated((0.0, 0.0, rise))
            parts += [Part(geom, kind, name) for geom in shapes.objects[name].geoms]
            there.append(shapes.objects[name].at(pose.position[None], pose.rotation[None]))
    return tuple(parts), Frames.joined(there)


def _carried(shapes: Solids, state: SymbolicState) -> list[tuple[Part, Shape]]:
    """Parts of the hand, of the closed fingers and of the held object, in the tool frame."""
    found = [(Part(shape.geom, HAND, HAND), shape) for shape in shapes.hand]
    for side, finger in shapes.fingers.items():
        found += [(Part(shape.geom, side, side), shape) for shape in finger]
    held = state.pose_tcp_object
    if state.holding is not None and held is not None:
        for geom, position, rotation in shapes.objects[state.holding]:
            shape = Shape(geom, held.apply(position), held.rotation @ rotation)
            found.append((Part(geom, LOAD, state.holding), shape))
    return found
