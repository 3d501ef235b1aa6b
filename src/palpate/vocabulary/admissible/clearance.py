"""Believed clearance of a straight motion: the volume swept by the hand, or by an object in it.

Objects and the hand's parts are boxes; a motion is sampled and every sample tested against the
boxes nearby.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError
from palpate.geometry.pose import Array, Pose
from palpate.scene.scene import Scene
from palpate.vocabulary.state import SymbolicState

SPACING = 0.02
"""m between two samples of a motion."""
STEEP = 0.010
"""m: a motion with less horizontal travel than this is vertical."""
TOUCH = 0.002
"""m: boxes that overlap by less only touch."""

ABOVE = 0.005
"""m: fingertips this far above an object's top are clear of it."""


@dataclass(frozen=True, slots=True, eq=False)
class Boxes:
    """Oriented boxes in the world: centres (n, 3), axes (n, 3, 3) as columns, half extents (n, 3),
    m."""

    centres: Array
    axes: Array
    halves: Array

    def overlap(self, others: Boxes, margin: float) -> NDArray[np.bool_]:
        """Mask over `others` (m,): boxes nearer than `margin` to any of these.

        Separating axes theorem on the 15 candidate axes of each pair.
        """
        apart = others.centres - self.centres[:, None]
        reach = _radii(self.halves)[:, None] + _radii(others.halves) + max(margin, 0.0)
        i, j = np.nonzero(np.einsum("ijk,ijk->ij", apart, apart) < reach**2)
        mine, theirs, between = self.axes[i], others.axes[j], apart[i, j]
        crossed = np.cross(mine[:, :, :, None], theirs[:, :, None, :], axis=1).reshape(
            len(mine), 3, 9
        )
        candidates = np.concatenate([mine, theirs, crossed], axis=2)
        radius = np.einsum(
            "nkj,nj->nk",
            np.abs(np.einsum("nik,nij->nkj", candidates, mine)),
            self.halves[i] + margin,
        )
        radius += np.einsum(
            "nkj,nj->nk", np.abs(np.einsum("nik,nij->nkj", candidates, theirs)), others.halves[j]
        )
        distance = np.abs(np.einsum("nik,ni->nk", candidates, between))
        separated = (distance > radius) & (np.linalg.norm(candidates, axis=1) > 1e-6)
        found = np.zeros(len(others.centres), dtype=np.bool_)
        found[j[~separated.any(axis=1)]] = True
        return found


def _radii(halves: Array) -> Array:
    return np.sqrt(np.einsum("ij,ij->i", halves, halves))


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """A straight motion of the TCP from `start` to `end` (world), with an object in the hand or
    none."""

    state: SymbolicState
    start: Pose
    end: Pose

    @property
    def vertical(self) -> bool:
        """True if it goes straight up or down."""
        return float(np.linalg.norm((self.end.position - self.start.position)[:2])) < STEEP

    def hits(self, ignoring: Collection[str] = (), margin: float = 0.0) -> list[str]:
        """Objects the hand, or what it holds, would run into, in document order; `margin` m is kept
        by the hand."""
        poses = [Pose(p, self.end.quaternion) for p in self._positions()]
        hand, held = self._hand(poses), self._held(poses)
        left_out = {*ignoring, self.state.holding}
        names = [name for name in self._beside() if name not in left_out]
        if not names:
            return []
        there = self._standing(names)
        found = hand.overlap(there, margin)
        if held is not None:
            found |= held.overlap(there, -TOUCH)
        return [name for name, met in zip(names, found, strict=True) if met]

    def _beside(self) -> Iterator[str]:
        """Objects near enough to be hit at all."""
        held = 2 * self.state.scene.body(self.state.holding).reach if self.state.holding else 0.0
        hand = self.state.scene.arm.hand
        width = hand.breadth + held
        (x0, y0, z0), (x1, y1, z1) = self.start.position.tolist(), self.end.position.tolist()
        points_down = self.end.rotation[2, 2] < -0.99
        lowest = min(z0, z1) - held - (hand.depth if points_down else hand.breadth + hand.height)
        dx, dy = x1 - x0, y1 - y0
        length = dx * dx + dy * dy
        for name, body in self.state.scene.objects.items():
            x, y, z = self.state.pose_of(name).position.tolist()
            if z + body.reach < lowest:
                continue
            share = (
                min(1.0, max(0.0, ((x - x0) * dx + (y - y0) * dy) / length))
                if length > 1e-12
                else 0.0
            )
            if body.is_near(x - x0 - share * dx, y - y0 - share * dy, width):
                yield name

    def _positions(self) -> Array:
        travel = float(np.linalg.norm(self.end.position - self.start.position))
        return np.linspace(
            self.start.position, self.end.position, max(2, int(np.ceil(travel / SPACING)) + 1)
        )

    def _hand(self, poses: list[Pose]) -> Boxes:
        boxes = self.state.scene.arm.hand.boxes
        centres = np.array([box.centre for box in boxes])
        halves = np.array([box.half for box in boxes])
        rotation = poses[0].rotation
        placed = np.concatenate([pose.position + centres @ rotation.T for pose in poses])
        return Boxes(
            placed, np.broadcast_to(rotation, (len(placed), 3, 3)), np.tile(halves, (len(poses), 1))
        )

    def _held(self, poses: list[Pose]) -> Boxes | None:
        if self.state.holding is None or self.state.pose_tcp_object is None:
            return None
        body = self.state.scene.body(self.state.holding)
        placed = [pose @ self.state.pose_tcp_object for pose in poses]
        return Boxes(
            np.array([p.apply(body.centre) for p in placed]),
            np.array([p.rotation for p in placed]),
            np.tile(body.size / 2, (len(placed), 1)),
        )

    def _standing(self, names: Sequence[str]) -> Boxes:
        centres: list[Array] = []
        axes: list[Array] = []
        halves: list[Array] = []
        for name in names:
            body, pose = self.state.scene.body(name), self.state.pose_of(name)
            centres.append(pose.apply(body.centre))
            axes.append(pose.rotation)
            halves.append(body.size / 2)
        return Boxes(np.array(centres), np.array(axes), np.array(halves))


def straddled(state: SymbolicState, pose_world_tcp: Pose | None) -> str | None:
    """The object that stands between the fingers at a pose, if any."""
    if pose_world_tcp is None:
        return None
    body = state.object_at(pose_world_tcp)
    if body is None:
        return None
    top = body.top_z(state.pose_of(body.name))
    return body.name if top > pose_world_tcp.position[2] - ABOVE else None


def blockers(state: SymbolicState, name: str, approach: Pose, work: Pose) -> list[str]:
    """Objects that must be away before the gripper can go from `approach` down to `work` on `name`
    and, if that is an object, lift it."""
    down = Motion(state, approach, work).hits(ignoring=(name,), margin=TOUCH)
    if name not in state.scene.objects:
        return down
    lifting = replace(state, holding=name, pose_tcp_object=work.inverse() @ state.pose_of(name))
    return list(dict.fromkeys([*down, *Motion(lifting, work, approach).hits()]))


def needed_away(scene: Scene, names: Iterable[str]) -> set[str]:
    """Objects that block one of `names`, or one that does, and so on."""
    state, found, queue = SymbolicState(scene), set[str](), list(names)
    while queue:
        name = queue.pop()
        for blocker in _at_rest(state, name):
            if blocker not in found:
                found.add(blocker)
                queue.append(blocker)
    return found


def _at_rest(state: SymbolicState, name: str) -> list[str]:
    symbol = f"{name}_pose" if name in state.scene.objects else f"{name}_approach"
    try:
        work = state.scene.symbols.resolve(symbol)
        return blockers(state, name, state.scene.symbols.resolve(f"{symbol} + z_offset"), work)
    except InputError:
        return []
