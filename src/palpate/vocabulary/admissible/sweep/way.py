"""The way that the arm takes: how it is bent, where the hand is and how far it is open, from
beginning to end."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from palpate.geometry.pose import Array, Pose
from palpate.robots.nominal import NominalArm
from palpate.vocabulary.admissible.solids import Solids

STEP = 0.02
"""m between two moments of a way."""
TURN = 0.1
"""rad between two moments, of the tool or of a joint."""
CORRECTIONS = 3
"""Newton steps from a posture between two postures onto the straight line."""
DAMPING = 1e-6
"""m^2, of a Newton step."""


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """A way at n moments, evenly spaced; between two of them everything changes evenly.

    Attributes:
        positions, quaternions: (n, 3) and (n, 4) of the TCP, world.
        widths: (n,) m between the fingers.
        q: (n, 7) rad; None where only the hand matters.
    """

    positions: Array
    quaternions: Array
    widths: Array
    q: Array | None = None

    @property
    def count(self) -> int:
        """Its moments."""
        return len(self.positions)

    def rotations(self) -> Array:
        """(n, 3, 3) of the TCP."""
        out = np.empty((self.count, 9))
        for i, quaternion in enumerate(self.quaternions):
            mujoco.mju_quat2Mat(out[i], quaternion)
        return out.reshape(-1, 3, 3)

    def between(self, moment: float) -> Way:
        """The one moment, which may lie between two."""
        i = min(int(moment), self.count - 2)
        share = moment - i
        first, last = self.quaternions[i], self.quaternions[i + 1]
        turned = (1 - share) * first + np.copysign(share, first @ last) * last

        def even(values: Array) -> Array:
            return ((1 - share) * values[i] + share * values[i + 1])[None]

        return Way(
            even(self.positions),
            (turned / np.linalg.norm(turned))[None],
            even(self.widths),
            None if self.q is None else even(self.q),
        )


def of_hand(start: Pose, end: Pose, width: float, step: float = STEP) -> Way:
    """The hand alone, straight from one pose to the other."""
    travel = end.position - start.position
    turn = np.empty(3)
    mujoco.mju_subQuat(turn, end.quaternion, start.quaternion)
    parts = max(np.linalg.norm(travel) / step, np.linalg.norm(turn) / TURN, 1.0)
    shares = np.linspace(0.0, 1.0, int(np.ceil(parts)) + 1)
    quaternions = np.empty((len(shares), 4))
    for i, share in enumerate(shares):
        quaternions[i] = start.quaternion
        mujoco.mju_quatIntegrate(quaternions[i], turn, share)
    return Way(start.position + shares[:, None] * travel, quaternions, np.full(len(shares), width))


def straight(solids: Solids, start: Pose, end: Pose, q: tuple[Array, Array], width: float) -> Way:
    """The TCP on a straight line, the arm bent from `q[0]` to `q[1]` as the controller would: its
    posture goes over evenly, and what that moves the TCP is taken back."""
    hand = of_hand(start, end, width)
    shares = np.linspace(0.0, 1.0, hand.count)[:, None]
    bent = (1 - shares) * q[0] + shares * q[1]
    for _ in range(CORRECTIONS):
        bent = bent + _correction(solids.arm, hand, bent)
    return Way(hand.positions, hand.quaternions, hand.widths, bent)


def of_joints(solids: Solids, start: Array, end: Array, width: float) -> Way:
    """All joints evenly from `start` to `end` (7,), rad: the trajectory of a joint motion."""
    farthest = float(np.abs(end - start).max())
    count = max(int(np.ceil(farthest / (TURN / 2))) + 1, 2)
    shares = np.linspace(0.0, 1.0, count)[:, None]
    q = (1 - shares) * start + shares * end
    poses = solids.arm.poses(q)
    return Way(poses[:, :3], poses[:, 3:], np.full(count, width), q)


def of_fingers(pose: Pose, start: float, end: float) -> Way:
    """The fingers alone, from one width to another, m."""
    return Way(
        np.tile(pose.position, (2, 1)), np.tile(pose.quaternion, (2, 1)), np.array([start, end])
    )


def _correction(arm: NominalArm, hand: Way, q: Array) -> Array:
    """(n, 7) rad of one Newton step that brings the TCP nearer to where the hand should be."""
    poses, jacobian = arm.stances(q)
    error = np.empty((len(q), 6))
    error[:, :3] = hand.positions - poses[:, :3]
    turn = np.empty(3)
    for i, (wanted, found) in enumerate(zip(hand.quaternions, poses[:, 3:], strict=True)):
        mujoco.mju_subQuat(turn, wanted, found)
        mujoco.mju_rotVecQuat(error[i, 3:], turn, found)
    transposed = jacobian.transpose(0, 2, 1)
    square = jacobian @ transposed + DAMPING * np.eye(6)
    return (transposed @ np.linalg.solve(square, error[:, :, None]))[:, :, 0]
