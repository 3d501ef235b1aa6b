"""Displacement of an object along the pads.

An object is put down, and gripped again, where two effects have moved it to. It slides along the pads as the
hand tilts. And where it droops, one end meets the support first: the object rotates about that end until it
lies flat, which moves the hand, or the object, by the height of the hand over the support times the angle.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from palpate.estimation.droop import LIKELY, Droop
from palpate.geometry.pose import Array, Pose
from palpate.mjcf.body import Body


@dataclass(frozen=True, slots=True)
class PutDown:
    """The end of a grasp.

    Attributes:
        grasp: s, when the hand had closed on the object.
        pose_tcp_body: where the object was in the hand then.
        droop: what had turned it until the hand came down with it.
        swept: rad by which tilts had turned the hand with it.
    """

    grasp: float
    pose_tcp_body: Pose
    droop: Droop
    swept: float

    def levelled(self, body: Body) -> float:
        """m (1 sigma): displacement along the fingers when a drooped object is put down and levels.
        Its end may slide on the support as well, so this is no evidence of the droop."""
        drooped = float(np.linalg.norm(self.droop.turns * LIKELY))
        return _height(self.pose_tcp_body, body) * drooped

    @property
    def slid(self) -> Array:
        """(3, 2) m per rad/rad, body frame: displacement by sliding along the tool's x and z. The
        part along z is reset when the object is put down."""
        along = self.pose_tcp_body.rotation[0]
        return np.column_stack([self.swept * along, np.zeros(3)])


def slid(pose_tcp_body: Pose, swept: float) -> Array:
    """(3, 2) m, body frame, by which what is in the hand has slid in this very grasp, for each metre
    that a radian lets it slide along the tool's x and z."""
    return swept * pose_tcp_body.rotation[[0, 2]].T


def before(grasp: float, put_down: Iterable[PutDown]) -> list[PutDown]:
    """Every time that it had been put down when it was grasped, s."""
    return [each for each in put_down if each.grasp < grasp]


def _height(pose_tcp_body: Pose, body: Body) -> float:
    """m of the TCP over the lowest place of an object, which it is gripped from above."""
    signs = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, -1).T
    corners = body.centre + signs * body.size
    return float(max(pose_tcp_body.apply(corner)[2] for corner in corners))
