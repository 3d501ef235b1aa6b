"""Paths of the arm, the hand and the fingers, sampled at moments.

A straight way of the TCP is gone by interpolated joint angles, corrected onto the line as the controller
does it. An object is lifted and lowered over one way, which is computed once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import mujoco
import numpy as np

from palpate.geometry.frames import Frames
from palpate.geometry.pose import Array, Pose, digits
from palpate.robots.trajectory import rotation_vector
from palpate.vocabulary.admissible.clearance import SAME_TURN
from palpate.vocabulary.admissible.solids import Solids

STEP = 0.02  # m between two moments of a path
TURN = 0.1  # rad between two moments, of the tool or of a joint
CORRECTIONS = 3  # Newton steps from interpolated joint angles onto the straight line
DAMPING = 1e-6  # m^2, of a Newton step


@dataclass(frozen=True, slots=True, eq=False)
class ArmPath:
    """Path of the arm, the hand and the fingers at n moments, evenly spaced; linear in between.

    Attributes:
        positions, quaternions: (n, 3) and (n, 4) of the TCP, world.
        widths: (n,) m between the fingers.
        q: (n, 7) rad; None where only the hand matters.
        links: poses of the arm's links, where they are computed already.
        key: of the way, for caches; empty without one.
        forth: the same path in the other direction, where this is the way back of a path with a key.
    """

    positions: Array
    quaternions: Array
    widths: Array
    q: Array | None = None
    links: Frames | None = None
    key: tuple[object, ...] = ()
    forth: ArmPath | None = None

    @property
    def count(self) -> int:
        """Number of moments."""
        return len(self.positions)

    def rotations(self) -> Array:
        """(n, 3, 3) of the TCP."""
        out = np.empty((self.count, 9))
        if (self.quaternions == self.quaternions[0]).all():
            mujoco.mju_quat2Mat(out[0], self.quaternions[0])
            out[1:] = out[0]
        else:
            for i, quaternion in enumerate(self.quaternions):
                mujoco.mju_quat2Mat(out[i], quaternion)
        return out.reshape(-1, 3, 3)

    def reversed(self) -> ArmPath:
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
    """Straight path of the hand alone."""
    travel = end.position - start.position
    turn = solids.turn(start, end)
    parts = max(np.linalg.norm(travel) / step, np.linalg.norm(turn) / TURN, 1.0)
    shares = np.linspace(0.0, 1.0, int(np.ceil(parts)) + 1)
    quaternions = np.tile(start.quaternion, (len(shares), 1))
    if turn.any():
        for quaternion, share in zip(quaternions, shares, strict=True):
            mujoco.mju_quatIntegrate(quaternion, turn, share)
    positions = start.position + shares[:, None] * travel
    return ArmPath(positions, quaternions, np.full(len(shares), width))


def straight_path(
    solids: Solids, start: Pose, end: Pose, q: tuple[Array, Array], width: float
) -> ArmPath:
    """Straight path of the TCP, the arm going from joint angles `q[0]` to `q[1]` as the controller
    takes it: interpolated joint angles, corrected onto the line by damped Newton steps."""
    here, there = (start.digits, digits(q[0])), (end.digits, digits(q[1]))
    # An object is lifted and lowered over one path, which is computed once. (Where the tool turns, it may
    # turn the other way round on its way back.)
    if here > there and start.angle_to(end) < SAME_TURN:
        return straight_path(solids, end, start, (q[1], q[0]), width).reversed()
    key = (*here, *there)
    path = solids.recent(("way", *key), lambda: _straight_path(solids, start, end, q))
    return replace(path, widths=np.full(path.count, width), key=(*key, width))


def _straight_path(solids: Solids, start: Pose, end: Pose, q: tuple[Array, Array]) -> ArmPath:
    return arm_path(solids, hand_path(solids, start, end, 0.0), q)


def arm_path(solids: Solids, hand: ArmPath, q: tuple[Array, Array]) -> ArmPath:
    """Path of the arm whose hand goes along `hand`, from joint angles `q[0]` to `q[1]`: interpolated
    joint angles, corrected onto it by damped Newton steps."""
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
        return finger_path(pose, end, start).reversed()
    positions, quaternions = np.tile(pose.position, (2, 1)), np.tile(pose.quaternion, (2, 1))
    key = ("fingers", pose.digits, round(start, 6), round(end, 6))
    return ArmPath(positions, quaternions, np.array([start, end]), key=key)


def _newton_step(solids: Solids, hand: ArmPath, q: Array) -> Array:
    """(n, 7) rad, Jᵀ (J Jᵀ + λ I)⁻¹ e with the TCP's error e (n, 6) from the path of the hand."""
    poses, jacobian = solids.arm.stances(q)
    error = np.empty((len(q), 6))
    error[:, :3] = hand.positions - poses[:, :3]
    for i, (wanted, found) in enumerate(zip(hand.quaternions, poses[:, 3:], strict=True)):
        mujoco.mju_rotVecQuat(error[i, 3:], rotation_vector(found, wanted), found)
    transposed = jacobian.transpose(0, 2, 1)
    square = jacobian @ transposed + DAMPING * np.eye(6)
    return (transposed @ np.linalg.solve(square, error[:, :, None]))[:, :, 0]
