"""Collision geometry of a sweep: the hand with its load, the arm's links, and everything static."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from palpate.geometry.frames import Frames
from palpate.geometry.pose import Array, Pose
from palpate.vocabulary.admissible.arrangement import Part, arrangement
from palpate.vocabulary.admissible.grip import grip
from palpate.vocabulary.admissible.path import ArmPath, hand_path
from palpate.vocabulary.admissible.solids import SIDES, ShapeGroup, Solids, solids
from palpate.vocabulary.admissible.sweep import Sweep
from palpate.vocabulary.state import SymbolicState

HAND = "hand"
LOAD = "load"
LINK = "link"
"""Kinds of parts of the arm, besides the two fingers."""
NEIGHBOURS = 2
"""Joints between two parts of the arm, up to which the parts cannot, or always nearly, touch."""
SPACING = 0.01  # m between two moments of `near_spans`


def hand_sweep(state: SymbolicState, path: ArmPath, growth: float) -> Sweep:
    """Sweep of the hand, its fingers and the load, among everything within `growth` m that is not
    held."""
    return _sweep(state, path, growth, {}, {})


def arm_sweep(
    state: SymbolicState, path: ArmPath, growth: float, higher: Mapping[str, float] | None = None
) -> Sweep:
    """Sweep of the whole arm with hand and load along a path with joint angles, among everything
    within `growth` m that is not held and its own links; objects are also placed `higher` by so many
    m."""
    return _sweep(state, path, growth, higher or {}, solids(state.scene).links)


def near_spans(
    state: SymbolicState, start: Pose, end: Pose, growth: float
) -> tuple[tuple[float, float], ...]:
    """Shares (first, last) of the TCP's straight path from `start` to `end` (world) on which the
    hand, the fingers or the load may come within `growth` m of anything; in order, disjoint."""
    path = hand_path(solids(state.scene), start, end, opening(state), SPACING)
    near = hand_sweep(state, path, growth).near(growth)
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


@dataclass(frozen=True, slots=True, eq=False)
class Carried:
    """Shapes that move with the tool: the hand, the closed fingers and the held object.

    Attributes:
        parts, group: the shapes, in the tool frame.
        sides: per metre of opening, how far each is beside the tool's axis along its y.
    """

    parts: tuple[Part, ...]
    group: ShapeGroup
    sides: Array

    def at(self, path: ArmPath) -> Frames:
        """Frames along a path."""
        rotations = path.rotations()
        hand = self.group.at(path.positions, rotations)
        beside = path.widths[:, None, None] * self.sides[:, None] * rotations[:, None, :, 1]
        return Frames(hand.positions + beside, hand.rotations)


def _sweep(
    state: SymbolicState,
    path: ArmPath,
    growth: float,
    higher: Mapping[str, float],
    joints: Mapping[int, int],
) -> Sweep:
    """`joints`: geom ids of the links to sweep as well, with the number of their joint."""
    if path.forth is not None:
        return _sweep(state, path.forth, growth, higher, joints).back()
    if not path.key:
        return _new_sweep(state, path, growth, higher, joints)
    load = state.pose_tcp_object and state.pose_tcp_object.digits
    around = (state.holding, load, *state.others(state.holding), *sorted(higher.items()))
    key = ("sweep", *path.key, growth, *around)
    return solids(state.scene).recent(key, lambda: _new_sweep(state, path, growth, higher, joints))


def _new_sweep(
    state: SymbolicState,
    path: ArmPath,
    growth: float,
    higher: Mapping[str, float],
    joints: Mapping[int, int],
) -> Sweep:
    shapes, still, carried = solids(state.scene), arrangement(state, higher), _carried(state)
    links = [Part(geom, LINK, shapes.owners[geom]) for geom in joints]
    # Number of the joint before each part; none before the base, and any between others and the arm.
    last = len(state.scene.arm.joints) + 1
    before = np.array([*[last] * len(carried.parts), *joints.values()], dtype=float)
    fixed = np.where(still.owners == state.scene.arm.base, 0.0, -np.inf)
    meets = before[:, None] - np.concatenate([before, fixed]) > NEIGHBOURS

    def place(path: ArmPath) -> Frames:
        if not links:
            return carried.at(path)
        assert path.q is not None
        return Frames.joined([carried.at(path), path.links or shapes.links_at(path.q)])

    return Sweep(shapes, path, (*carried.parts, *links), place, still, meets, growth)


def _carried(state: SymbolicState) -> Carried:
    shapes, held = solids(state.scene), state.pose_tcp_object
    hand = shapes.cached("hand", lambda: _hand(shapes))
    if state.holding is None or held is None:
        return hand
    load = shapes.objects[state.holding]
    there = load.at(held.position[None], held.rotation[None])
    group = ShapeGroup(
        (*hand.group.geoms, *load.geoms),
        np.concatenate([hand.group.positions, there.positions[0]]),
        np.concatenate([hand.group.rotations, there.rotations[0]]),
    )
    parts = (*hand.parts, *(Part(geom, LOAD, state.holding) for geom in load.geoms))
    return Carried(parts, group, np.concatenate([hand.sides, np.zeros(len(load.geoms))]))


def _hand(shapes: Solids) -> Carried:
    parts = [Part(geom, HAND, HAND) for geom in shapes.hand.geoms]
    found = list(shapes.hand)
    for side, finger in shapes.fingers.items():
        parts += [Part(geom, side, side) for geom in finger.geoms]
        found += finger
    sides = np.array([SIDES.get(part.kind, 0.0) for part in parts]) / 2
    return Carried(tuple(parts), ShapeGroup.of(found), sides)
