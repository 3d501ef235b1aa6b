"""Forward kinematics of the joint axes of an arm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.geometry.pose import Array
from palpate.trace.recording import Chain


@dataclass(frozen=True, slots=True, eq=False)
class Hinge:
    """A joint at k configurations, in the base's axes.

    Attributes:
        axis, anchor: (k, 3) unit, m.
        frame, origin: (k, 3, 3) and (k, 3) m, of what moves with it: the base's own at angles 0.
    """

    axis: Array
    anchor: Array
    frame: Array
    origin: Array


def hinges(chain: Chain, q: Array) -> list[Hinge]:
    """At joint angles `q` (k, m), rad, from the base on.

    A product of exponentials (Lynch and Park, Modern Robotics, 2017, chapter 4): every hinge turns
    what comes after it about the axis that those before it have turned.
    """
    found: list[Hinge] = []
    frame, origin = np.broadcast_to(np.eye(3), (len(q), 3, 3)), np.zeros((len(q), 3))
    for own, place, angle in zip(chain.axes, chain.anchors, q.T, strict=True):
        axis = frame @ np.array(own)
        anchor = frame @ np.array(place) + origin
        frame = frame @ about(np.array(own), angle)
        origin = anchor - frame @ np.array(place)
        found.append(Hinge(axis, anchor, frame, origin))
    return found


def about(axis: Array, angle: Array) -> Array:
    """(k, 3, 3) rotations by `angle` (k,) about a unit `axis` (3,), by Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, cosine = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + sine * cross + (1.0 - cosine) * (cross @ cross)
