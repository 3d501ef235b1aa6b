"""Clearance of a straight motion: the volume swept by the hand and the held object, by boxes.

Objects and the hand's parts are boxes; a motion is sampled, and every sample tested against the
boxes nearby.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError
from palpate.geometry.pose import Array, Pose
from palpate.scene.scene import Scene
from palpate.vocabulary.admissible.solids import solids
from palpate.vocabulary.state import SymbolicState

SPACING = 0.02  # m between two samples of a motion
STEEP = 0.010  # m of horizontal travel below which a motion is vertical
SAME_TURN = 1e-6  # rad up to which two orientations are one
TOUCH = 0.002  # m of overlap up to which boxes only touch


@dataclass(frozen=True, slots=True, eq=False)
class Boxes:
    """Oriented boxes in the world: centres (n, 3), axes (n, 3, 3) as columns, half extents (n, 3),
    m."""

    centres: Array
    axes: Array
    halves: Array

    def overlap(self, others: Boxes, margin: float) -> NDArray[np.bool_]:
        """Mask over `others` (m,): boxes nearer than `margin` to any of these.

        Separating axis theorem: two boxes are apart if their projections are on one of 15 axes, the
        three of each box and the nine cross products.
        """
        # Bounding spheres rule out most pairs.
        apart = others.centres - self.centres[:, None]
        reach = _radii(self.halves)[:, None] + _radii(others.halves) + max(margin, 0.0)
        i, j = np.nonzero(np.einsum("ijk,ijk->ij", apart, apart) < reach**2)
        found = np.zeros(len(others.centres), dtype=np.bool_)
        if not len(i):
            return found
        mine, theirs, between = self.axes[i], others.axes[j], apart[i, j]
        crossed = np.cross(mine[:, :, :, None], theirs[:, :, None, :], axis=1)
        candidates = np.concatenate([mine, theirs, crossed.reshape(len(mine), 3, 9)], axis=2)
        radius = _projected(candidates, mine, self.halves[i] + margin)
        radius += _projected(candidates, theirs, others.halves[j])
        distance = np.abs(np.einsum("nik,ni->nk", candidates, between))
        # Cross products of parallel axes vanish and separate nothing.
        separated = (distance > radius) & (np.linalg.norm(candidates, axis=1) > 1e-6)
        found[j[~separated.any(axis=1)]] = True
        return found


def _radii(halves: Array) -> Array:
    return np.sqrt(np.einsum("ij,ij->i", halves, halves))


def _projected(candidates: Array, axes: Array, halves: Array) -> Array:
    """(n, k) half extents of boxes along candidate axes (n, 3, k)."""
    return np.einsum("nkj,nj->nk", np.abs(np.einsum("nik,nij->nkj", candidates, axes)), halves)


def is_vertical(start: Pose, end: Pose) -> bool:
    """True for a motion straight up or down."""
    return float(np.linalg.norm((end.position - start.position)[:2])) < STEEP


def box_hits(
    state: SymbolicState, start: Pose, end: Pose, ignoring: Collection[str] = (), margin: float = 0
) -> list[str]:
    """Objects that the hand, or the held object, would run into on the TCP's straight motion from
    `start` to `end` (world), in document order; the hand keeps `margin` m."""
    ends = (start.digits, end.digits)
    # There and back is one volume, unless the tool turns on the way.
    ends = tuple(sorted(ends)) if start.angle_to(end) < SAME_TURN else ends
    load = state.pose_tcp_object and state.pose_tcp_object.digits
    key = ("boxes", *ends, frozenset(ignoring), margin, state.holding, load)
    key = (*key, *state.others(state.holding))
    return solids(state.scene).cached(
        key, lambda: _box_hits(state, start, end, {*ignoring, state.holding}, margin)
    )


def _box_hits(
    state: SymbolicState, start: Pose, end: Pose, ignoring: Collection[str | None], margin: float
) -> list[str]:
    names = [name for name in _nearby(state, start, end) if name not in ignoring]
    if not names:
        return []
    travel = float(np.linalg.norm(end.position - start.position))
    samples = max(2, int(np.ceil(travel / SPACING)) + 1)
    positions = np.linspace(start.position, end.position, samples)
    there = _boxes(state, [(name, state.pose_of(name)) for name in names])
    found = _hand(state, positions, end.rotation).overlap(there, margin)
    held = state.pose_tcp_object
    if state.holding is not None and held is not None:
        poses = [Pose(position, end.quaternion) @ held for position in positions]
        carried = _boxes(state, [(state.holding, pose) for pose in poses])
        found |= carried.overlap(there, -TOUCH)
    return [name for name, met in zip(names, found, strict=True) if met]


def _nearby(state: SymbolicState, start: Pose, end: Pose) -> Iterator[str]:
    """Objects near enough to a motion to be hit at all, by bounding spheres."""
    held = 2 * state.scene.body(state.holding).reach if state.holding else 0.0
    hand = state.scene.arm.hand
    points_down = end.rotation[2, 2] < -0.99
    depth = hand.depth if points_down else hand.breadth + hand.height
    lowest = min(float(start.position[2]), float(end.position[2])) - held - depth
    for body in state.beside(start.position, end.position, hand.breadth + held):
        top = float(state.pose_of(body.name).position[2]) + body.reach
        if body.role == "object" and top >= lowest:
            yield body.name


def _hand(state: SymbolicState, positions: Array, rotation: Array) -> Boxes:
    """Boxes of the hand with the TCP at positions (n, 3)."""
    boxes = state.scene.arm.hand.boxes
    centres = np.array([box.centre for box in boxes]) @ rotation.T
    placed = (positions[:, None] + centres).reshape(-1, 3)
    axes = np.broadcast_to(rotation, (len(placed), 3, 3))
    return Boxes(placed, axes, np.tile([box.half for box in boxes], (len(positions), 1)))


def _boxes(state: SymbolicState, placed: list[tuple[str, Pose]]) -> Boxes:
    """Bounding boxes of objects at poses."""
    bodies = [(state.scene.body(name), pose) for name, pose in placed]
    return Boxes(
        np.array([pose.apply(body.centre) for body, pose in bodies]),
        np.array([pose.rotation for _, pose in bodies]),
        np.array([body.size / 2 for body, _ in bodies]),
    )


def straddled(state: SymbolicState, pose_world_tcp: Pose | None) -> str | None:
    """Object between the fingers at a pose, if any."""
    body = state.object_at(pose_world_tcp)
    return None if body is None else body.name


def blockers(state: SymbolicState, name: str, approach: Pose, work: Pose) -> list[str]:
    """Objects to clear away before the gripper can go from `approach` down to `work` on `name` and,
    if that is an object, lift it."""
    down = box_hits(state, approach, work, ignoring=(name,), margin=TOUCH)
    if name not in state.scene.objects:
        return down
    lifting = replace(state, holding=name, pose_tcp_object=work.inverse() @ state.pose_of(name))
    return list(dict.fromkeys([*down, *box_hits(lifting, work, approach)]))


def needed_away(scene: Scene, names: Iterable[str]) -> set[str]:
    """Objects that block one of `names`, or another blocker."""
    state, found, queue = SymbolicState(scene), set[str](), list(names)
    while queue:
        name = queue.pop()
        symbol = f"{name}_pose" if name in scene.objects else f"{name}_approach"
        try:
            work = state.resolve(symbol)
            approach = state.resolve(f"{symbol} + z_offset")
        except InputError:
            continue
        blocking = set(blockers(state, name, approach, work)) - found
        found |= blocking
        queue += blocking
    return found
