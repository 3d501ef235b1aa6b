"""Clearance of straight motions by oriented boxes, and sampled paths of the arm and hand."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from palpate.common.errors import InputError
from palpate.common.pose import Array, Frames, Pose, digits
from palpate.mjcf.body import Body
from palpate.primitives.rules.solids import Solids, solids
from palpate.primitives.state import SymbolicState
from palpate.robots.trajectory import rotation_vector
from palpate.scene.scene import Scene

SPACING = 0.02  # m between two samples of a motion
STEEP = 0.010  # m of horizontal travel below which a motion is vertical
SAME_TURN = 1e-6  # rad up to which two orientations are one
TOUCH = 0.002  # m of overlap up to which boxes only touch
Numbers = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class Boxes:
    """Oriented boxes in the world."""

    centres: Array  # (n, 3), m
    axes: Array  # (n, 3, 3), unit axes as columns
    halves: Array  # (n, 3), half extents, m

    def at(self, positions: Array) -> Boxes:
        """Copies of the boxes, their frame moved to each of `positions` (m, 3): m n boxes."""
        count = len(positions)
        centres = (positions[:, None] + self.centres).reshape(-1, 3)
        return Boxes(centres, np.tile(self.axes, (count, 1, 1)), np.tile(self.halves, (count, 1)))

    def overlap(self, others: Boxes, margin: float) -> NDArray[np.bool_]:
        """Mask over `others` (m,): boxes nearer than `margin` to any of these.

        Separating axis theorem: two boxes are disjoint if their projections on one of 15 axes are.
        The axes are the three of each box and the nine cross products.
        """
        # Bounding spheres rule out most pairs.
        apart = others.centres - self.centres[:, None]
        reach = _radii(self.halves)[:, None] + _radii(others.halves) + max(margin, 0.0)
        i, j = np.nonzero(np.einsum("ijk,ijk->ij", apart, apart) < reach**2)
        found = np.zeros(len(others.centres), dtype=np.bool_)
        # The six face normals come first: they separate most of the remaining pairs.
        faces = np.concatenate([self.axes[i], others.axes[j]], axis=2)
        i, j = self._overlapping_pairs(others, margin, i, j, faces)
        if len(i):  # rare: the face normals separate most pairs
            edges = np.cross(self.axes[i][:, :, :, None], others.axes[j][:, :, None], axis=1)
            _, j = self._overlapping_pairs(others, margin, i, j, edges.reshape(len(i), 3, 9))
        found[j] = True
        return found

    def _overlapping_pairs(
        self, others: Boxes, margin: float, i: Numbers, j: Numbers, axes: Array
    ) -> tuple[Numbers, Numbers]:
        """Select the pairs `i` and `j` (n,) that none of their axes (n, 3, k) separates."""
        # Compare the projected half extents with the projected distance of the centres.
        radius = _project_boxes(axes, self.axes[i], self.halves[i] + margin)
        radius += _project_boxes(axes, others.axes[j], others.halves[j])
        distance = np.abs(np.einsum("nik,ni->nk", axes, others.centres[j] - self.centres[i]))
        # Cross products of parallel axes vanish and separate nothing.
        separated = (distance > radius) & (np.linalg.norm(axes, axis=1) > 1e-6)
        met = ~separated.any(axis=1)
        return i[met], j[met]


def _radii(halves: Array) -> Array:
    """(n,) m, radii of the bounding spheres of boxes with half extents (n, 3)."""
    return np.sqrt(np.einsum("ij,ij->i", halves, halves))


def _project_boxes(candidates: Array, axes: Array, halves: Array) -> Array:
    """(n, k) half extents of boxes along candidate axes (n, 3, k)."""
    return np.einsum("nkj,nj->nk", np.abs(np.einsum("nik,nij->nkj", candidates, axes)), halves)


def is_vertical(start: Pose, end: Pose) -> bool:
    """True for a motion straight up or down."""
    return float(np.linalg.norm((end.position - start.position)[:2])) < STEEP


def box_hits(
    state: SymbolicState, start: Pose, end: Pose, ignoring: Collection[str] = (), margin: float = 0
) -> list[str]:
    """Objects that the hand or the held object would hit on a straight motion, in document order.

    The TCP goes from `start` to `end` (world). The hand keeps `margin` m.
    """
    ends = (start.digits, end.digits)
    # Both directions sweep the same volume, unless the tool turns on the way.
    ends = tuple(sorted(ends)) if start.angle_to(end) < SAME_TURN else ends
    load = state.pose_tcp_object and state.pose_tcp_object.digits
    key = ("boxes", *ends, frozenset(ignoring), margin, state.holding, load)
    key = (*key, *state.others(state.holding))
    return solids(state.scene).get_or_compute(
        key, lambda: _box_hits(state, start, end, {*ignoring, state.holding}, margin)
    )


def _box_hits(
    state: SymbolicState, start: Pose, end: Pose, ignoring: Collection[str | None], margin: float
) -> list[str]:
    """Objects that `box_hits` finds, by oriented boxes at samples of the motion."""
    names = [name for name in _nearby(state, start, end) if name not in ignoring]
    if not names:
        return []
    # Sample the motion at most `SPACING` apart, and test the hand's boxes at all samples.
    travel = float(np.linalg.norm(end.position - start.position))
    samples = max(2, int(np.ceil(travel / SPACING)) + 1)
    positions = np.linspace(start.position, end.position, samples)
    there = _boxes([(state.scene.body(name), state.pose_of(name)) for name in names])
    found = _hand(state.scene, end.rotation).at(positions).overlap(there, margin)
    held = state.pose_tcp_object
    if state.holding is not None and held is not None:
        # The held object is tested by its bounding box in the same way.
        turned = Pose(np.zeros(3), end.quaternion) @ held
        load = _boxes([(state.scene.body(state.holding), turned)]).at(positions)
        found |= load.overlap(there, -TOUCH)
    return [name for name, met in zip(names, found, strict=True) if met]


def _nearby(state: SymbolicState, start: Pose, end: Pose) -> Iterator[str]:
    """Objects within reach of a motion, by bounding spheres."""
    held = 2 * state.scene.body(state.holding).reach if state.holding else 0.0
    hand = state.scene.arm.hand
    points_down = end.rotation[2, 2] < -0.99
    depth = hand.depth if points_down else hand.breadth + hand.height
    # An object below the lowest point of hand and load cannot be hit.
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


def straddled_object(state: SymbolicState, pose_world_tcp: Pose | None) -> str | None:
    """Object between the fingers at a pose, if any."""
    body = state.object_at(pose_world_tcp)
    return None if body is None else body.name


def blockers(state: SymbolicState, name: str, approach: Pose, work: Pose) -> list[str]:
    """Objects to clear away before the gripper can go down to `name`, and lift it if it is an object."""
    down = box_hits(state, approach, work, ignoring=(name,), margin=TOUCH)
    if name not in state.scene.objects:
        return down
    lifting = replace(state, holding=name, pose_tcp_object=work.inverse() @ state.pose_of(name))
    return list(dict.fromkeys([*down, *box_hits(lifting, work, approach)]))


def needed_away(scene: Scene, names: Iterable[str]) -> set[str]:
    """Objects that block one of `names` or another blocker: the transitive closure of `blockers`."""
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


# Sampled paths of the arm, the hand and the fingers.


STEP = 0.02  # m between two moments of a path
TURN = 0.1  # rad between two moments, of the tool or of a joint
CORRECTIONS = 3  # Newton steps from interpolated joint angles onto the straight line
DAMPING = 1e-6  # m^2, of a Newton step


@dataclass(frozen=True, slots=True, eq=False)
class ArmPath:
    """Path of the arm, the hand and the fingers at n moments, evenly spaced; linear in between."""

    # positions, quaternions: (n, 3) and (n, 4) of the TCP, world
    positions: Array
    quaternions: Array
    widths: Array  # (n,) m between the fingers
    q: Array | None = None  # (n, 7) rad; None where only the hand matters
    links: Frames | None = None  # poses of the arm's links, where they are computed already
    key: tuple[object, ...] = ()  # cache key of the path; empty without one
    # The path of the opposite direction, if this path was made by reversing it.
    forth: ArmPath | None = None

    @property
    def count(self) -> int:
        """Number of moments."""
        return len(self.positions)

    def rotations(self) -> Array:
        """(n, 3, 3) of the TCP."""
        out = np.empty((self.count, 9))
        # Most motions keep the orientation: convert its quaternion once.
        if (self.quaternions == self.quaternions[0]).all():
            mujoco.mju_quat2Mat(out[0], self.quaternions[0])
            out[1:] = out[0]
        else:
            for i, quaternion in enumerate(self.quaternions):
                mujoco.mju_quat2Mat(out[i], quaternion)
        return out.reshape(-1, 3, 3)

    def reverse(self) -> ArmPath:
        """The way back."""
        links = self.links and Frames(self.links.positions[::-1], self.links.rotations[::-1])
        q = None if self.q is None else self.q[::-1]
        back = (self.positions[::-1], self.quaternions[::-1], self.widths[::-1])
        return ArmPath(*back, q, links, forth=self)

    def between(self, moments: Array) -> ArmPath:
        """Interpolate n moments, fractions between two of the path."""
        i = np.minimum(moments.astype(int), self.count - 2)
        share = (moments - i)[:, None]
        first, last = self.quaternions[i], self.quaternions[i + 1]
        # Quaternions of opposite sign are one rotation: interpolate the shorter way.
        cosines = np.einsum("ij,ij->i", first, last)[:, None]
        turned = (1 - share) * first + np.copysign(share, cosines) * last

        def linear(values: Array) -> Array:
            return (1 - share) * values[i] + share * values[i + 1]

        return ArmPath(
            linear(self.positions),
            turned / np.linalg.norm(turned, axis=1, keepdims=True),
            linear(self.widths[:, None])[:, 0],
            None if self.q is None else linear(self.q),
        )


def hand_path(solids: Solids, start: Pose, end: Pose, width: float, step: float = STEP) -> ArmPath:
    """Return the straight path of the hand alone, moments at most `step` m and `TURN` rad apart."""
    travel = end.position - start.position
    turn = solids.turn(start, end)
    parts = max(np.linalg.norm(travel) / step, np.linalg.norm(turn) / TURN, 1.0)
    shares = np.linspace(0.0, 1.0, int(np.ceil(parts)) + 1)
    # Rotate about a fixed axis in proportion to the path: q(s) = q0 exp(s θ).
    quaternions = np.tile(start.quaternion, (len(shares), 1))
    if turn.any():
        for quaternion, share in zip(quaternions, shares, strict=True):
            mujoco.mju_quatIntegrate(quaternion, turn, share)
    positions = start.position + shares[:, None] * travel
    return ArmPath(positions, quaternions, np.full(len(shares), width))


def straight_path(
    solids: Solids, start: Pose, end: Pose, q: tuple[Array, Array], width: float
) -> ArmPath:
    """Return the straight path of the TCP, with joint angles from `q[0]` to `q[1]` corrected onto it."""
    here, there = (start.digits, digits(q[0])), (end.digits, digits(q[1]))
    # An object is lifted and lowered along one path, which is computed once. A path with a turn is
    # excluded: the tool may turn in the other sense on its way back.
    if here > there and start.angle_to(end) < SAME_TURN:
        return straight_path(solids, end, start, (q[1], q[0]), width).reverse()
    key = (*here, *there)
    path = solids.recent(
        ("way", *key), lambda: arm_path(solids, hand_path(solids, start, end, 0.0), q)
    )
    return replace(path, widths=np.full(path.count, width), key=(*key, width))


def arm_path(solids: Solids, hand: ArmPath, q: tuple[Array, Array]) -> ArmPath:
    """Return the arm's path along `hand`: joint angles interpolated, then corrected by damped Newton steps."""
    shares = np.linspace(0.0, 1.0, hand.count)[:, None]
    bent = (1 - shares) * q[0] + shares * q[1]
    for _ in range(CORRECTIONS):
        bent = bent + _newton_step(solids, hand, bent)
    return replace(hand, q=bent, links=solids.links_at(bent))


def joint_path(solids: Solids, start: Array, end: Array, width: float) -> ArmPath:
    """Path of a joint motion: all joints linearly from `start` to `end` (7,), rad."""
    farthest = float(np.abs(end - start).max())
    count = max(int(np.ceil(farthest / (TURN / 2))) + 1, 2)
    shares = np.linspace(0.0, 1.0, count)[:, None]
    q = (1 - shares) * start + shares * end
    poses = solids.arm.poses(q)
    return ArmPath(poses[:, :3], poses[:, 3:], np.full(count, width), q)


def finger_path(pose: Pose, start: float, end: float) -> ArmPath:
    """Path of the fingers alone, from one opening to another, m."""
    if start > end:
        return finger_path(pose, end, start).reverse()
    positions, quaternions = np.tile(pose.position, (2, 1)), np.tile(pose.quaternion, (2, 1))
    key = ("fingers", pose.digits, round(start, 6), round(end, 6))
    return ArmPath(positions, quaternions, np.array([start, end]), key=key)


def _newton_step(solids: Solids, hand: ArmPath, q: Array) -> Array:
    """Damped least-squares step Jᵀ (J Jᵀ + λ I)⁻¹ e, (n, 7), rad.

    e (n, 6) is the TCP's error from the path of the hand, in m and rad, and λ is `DAMPING`.
    """
    poses, jacobian = solids.arm.stances(q)
    error = np.empty((len(q), 6))
    error[:, :3] = hand.positions - poses[:, :3]
    for i, (wanted, found) in enumerate(zip(hand.quaternions, poses[:, 3:], strict=True)):
        # Rotate the orientation error from the tool's axes into those of the Jacobian.
        mujoco.mju_rotVecQuat(error[i, 3:], rotation_vector(found, wanted), found)
    transposed = jacobian.transpose(0, 2, 1)
    square = jacobian @ transposed + DAMPING * np.eye(6)
    return (transposed @ np.linalg.solve(square, error[:, :, None]))[:, :, 0]
