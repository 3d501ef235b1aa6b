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
from palpate.mjcf.body import Body
from palpate.scene.scene import Scene
from palpate.vocabulary.admissible.solids import solids
from palpate.vocabulary.state import SymbolicState

SPACING = 0.02  # m between two samples of a motion
STEEP = 0.010  # m of horizontal travel below which a motion is vertical
SAME_TURN = 1e-6  # rad up to which two orientations are one
TOUCH = 0.002  # m of overlap up to which boxes only touch

Numbers = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class Boxes:
    """Oriented boxes in the world: centres (n, 3), axes (n, 3, 3) as columns, half extents (n, 3),
    m."""

    centres: Array
    axes: Array
    halves: Array

    def at(self, positions: Array) -> Boxes:
        """The boxes of a frame at each of some positions (m, 3) of it."""
        count = len(positions)
        centres = (positions[:, None] + self.centres).reshape(-1, 3)
        return Boxes(centres, np.tile(self.axes, (count, 1, 1)), np.tile(self.halves, (count, 1)))

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
        faces = np.concatenate([self.axes[i], others.axes[j]], axis=2)
        i, j = self._met(others, margin, i, j, faces)
        if len(i):  # seldom: the normals of faces separate most
            edges = np.cross(self.axes[i][:, :, :, None], others.axes[j][:, :, None], axis=1)
            _, j = self._met(others, margin, i, j, edges.reshape(len(i), 3, 9))
        found[j] = True
        return found

    def _met(
        self, others: Boxes, margin: float, i: Numbers, j: Numbers, axes: Array
    ) -> tuple[Numbers, Numbers]:
        """Select the pairs `i` and `j` (n,) that none of their axes (n, 3, k) separates."""
        radius = _projected(axes, self.axes[i], self.halves[i] + margin)
        radius += _projected(axes, others.axes[j], others.halves[j])
        distance = np.abs(np.einsum("nik,ni->nk", axes, others.centres[j] - self.centres[i]))
        # Cross products of parallel axes vanish and separate nothing.
        separated = (distance > radius) & (np.linalg.norm(axes, axis=1) > 1e-6)
        met = ~separated.any(axis=1)
        return i[met], j[met]


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
    there = _boxes([(state.scene.body(name), state.pose_of(name)) for name in names])
    found = _hand(state.scene, end.rotation).at(positions).overlap(there, margin)
    held = state.pose_tcp_object
    if state.holding is not None and held is not None:
        turned = Pose(np.zeros(3), end.quaternion) @ held
        load = _boxes([(state.scene.body(state.holding), turned)]).at(positions)
        found |= load.overlap(there, -TOUCH)
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


def _hand(scene: Scene, rotation: Array) -> Boxes:
    """Boxes of the hand with the TCP at the origin."""
    boxes = scene.arm.hand.boxes
    centres = np.array([box.centre for box in boxes]) @ rotation.T
    axes = np.broadcast_to(rotation, (len(boxes), 3, 3))
    return Boxes(centres, axes, np.array([box.half for box in boxes]))


def _boxes(placed: Iterable[tuple[Body, Pose]]) -> Boxes:
    """Bounding boxes of bodies at poses."""
    found = [(pose.apply(body.centre), pose.rotation, body.size / 2) for body, pose in placed]
    centres, axes, halves = zip(*found, strict=True)
    return Boxes(np.array(centres), np.array(axes), np.array(halves))


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
