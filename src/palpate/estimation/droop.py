"""Rotation of an object between the pads by its own weight.

Pads give way at once, and creep: a hammer held beside its balance point turns about the axis along
which the fingers close, the farther the longer it is held, always the way its weight pulls. How far
a newton metre turns it, and how fast, is not known beforehand but for that sign: each is half a normal
distribution (`tuning.GRIP_TURN`, `tuning.GRIP_CREEP`), and counts with its mean and its variance. Of one
object between one pair of pads it is the same in all grasps, and is fitted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.estimation import tuning
from palpate.geometry.pose import Array, Pose

LIKELY = np.array([tuning.GRIP_TURN, tuning.GRIP_CREEP])
"""(2,) rad per N m, and rad/s per N m: root mean square of what is not known and cannot be negative."""

EXPECTED: Array = np.sqrt(2.0 / np.pi) * LIKELY
"""(2,) its mean."""

SPREAD: Array = np.sqrt(1.0 - 2.0 / np.pi) * LIKELY
"""(2,) 1 sigma of it."""


@dataclass(frozen=True, slots=True)
class Droop:
    """Cause of an object's rotation in the hand: moment and time.

    Attributes:
        moment: N m that the hand holds it with about the axis along which the fingers close, as it
            hangs level.
        age: s since the fingers closed on it.
    """

    moment: float
    age: float

    @classmethod
    def since(cls, grasp: float, time: float, moment: float) -> Droop:
        """Droop at `time`, s, of an object grasped at `grasp`, s; -inf is an unknown grasp."""
        return cls(moment, max(0.0, time - grasp) if np.isfinite(grasp) else 0.0)

    @property
    def turns(self) -> Array:
        """(2,) rad about the tool's y for each unit of what is not known."""
        return -self.moment * np.array([1.0, self.age])

    def turned(self, pose_tcp_body: Pose, softness: Array) -> Pose:
        """Pose of the object in the hand after the rotation, for `softness` (2,) of the pads."""
        half = float(self.turns @ softness) / 2.0
        turn = Pose.of(np.zeros(3), (np.cos(half), 0.0, np.sin(half), 0.0))
        return turn @ pose_tcp_body
