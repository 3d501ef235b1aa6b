"""Motion of an object in the grip: droop about the closing axis, and slip along the pads.

Pads deform elastically at once, and creep: a hammer held beside its balance point turns about the axis
along which the fingers close, always in the direction of its weight, and farther the longer it is held.
The rotation per newton metre and its rate are unknown but for their sign: each has half a normal
distribution (`tuning.GRIP_TURN`, `tuning.GRIP_CREEP`), with its mean and its variance. For one object
between one pair of pads they are the same in all grasps, and are fitted.

Two effects move an object before it is gripped again. It slides along the pads as the hand tilts. And
where it droops, one end meets the support first: the object rotates about that end until it lies flat,
which moves the hand, or the object, by the height of the hand over the support times the angle.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from palpate.estimation import tuning
from palpate.geometry.pose import Array, Pose
from palpate.mjcf.body import Body

LIKELY = np.array([tuning.GRIP_TURN, tuning.GRIP_CREEP])
"""(2,) rad per N m, and rad/s per N m: root mean square of the unknown rotation and its rate."""

EXPECTED: Array = np.sqrt(2.0 / np.pi) * LIKELY
"""(2,) mean of half a normal distribution."""

SPREAD: Array = np.sqrt(1.0 - 2.0 / np.pi) * LIKELY
"""(2,) standard deviation of half a normal distribution."""


@dataclass(frozen=True, slots=True)
class Droop:
    """Cause of an object's rotation in the hand.

    Attributes:
        moment: N m of the level object about the axis along which the fingers close.
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
        """(2,) rad about the tool's y per unit of the softness of the pads."""
        return -self.moment * np.array([1.0, self.age])

    def turned(self, pose_tcp_body: Pose, softness: Array) -> Pose:
        """Pose of the object in the hand after the rotation, for `softness` (2,) of the pads."""
        half = float(self.turns @ softness) / 2.0
        turn = Pose.of(np.zeros(3), (np.cos(half), 0.0, np.sin(half), 0.0))
        return turn @ pose_tcp_body


@dataclass(frozen=True, slots=True)
class PutDown:
    """End of a grasp.

    Attributes:
        grasp: s, when the hand had closed on the object.
        pose_tcp_body: of the object in the hand at that time.
        droop: until the hand came down with it.
        swept: rad by which tilts had turned the hand with it.
    """

    grasp: float
    pose_tcp_body: Pose
    droop: Droop
    swept: float

    def levelled(self, body: Body) -> float:
        """m (1 sigma), displacement along the fingers when a drooped object is put down and levels. Its end
        may slide on the support as well, so this is no evidence of the droop."""
        drooped = float(np.linalg.norm(self.droop.turns * LIKELY))
        signs = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, -1).T
        corners = body.centre + signs * body.size
        # The object is gripped from above: the tool axis points at its lowest corner.
        height = float(max(self.pose_tcp_body.apply(corner)[2] for corner in corners))
        return height * drooped

    @property
    def slid(self) -> Array:
        """(3, 2) m per rad/rad, body frame: displacement by sliding along the tool's x and z. The part along
        z is reset when the object is put down."""
        along = self.pose_tcp_body.rotation[0]
        return np.column_stack([self.swept * along, np.zeros(3)])


def slid(pose_tcp_body: Pose, swept: float) -> Array:
    """(3, 2) m, body frame: displacement within the present grasp per metre of slip along the tool's x and z
    and radian of tilt."""
    return swept * pose_tcp_body.rotation[[0, 2]].T


def before(grasp: float, put_down: Iterable[PutDown]) -> list[PutDown]:
    """All put-downs before a grasp at `grasp`, s."""
    return [each for each in put_down if each.grasp < grasp]
