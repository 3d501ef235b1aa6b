"""Regressor of an arm: joint torques, linear in ten inertial parameters of each link.

The parameters of a link are its mass m, kg, its first moment h = m c, kg m, and its inertia xx yy zz xy xz yz,
kg m², both about its joint's anchor, in axes that are those of the base at joint angles 0 (Khalil and Dombre,
Modeling, Identification and Control of Robots, 2002, chapter 12).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from palpate.estimation.load.chain import hinges
from palpate.geometry.pose import Array, components, tensor_of
from palpate.trace.recording import Chain, Link

PARAMETERS = 10


def regressor(chain: Chain, q: Array, dq: Array, ddq: Array, gravity: Array) -> Array:
    """(n, 7, 7, 10) joint torques by a unit of each parameter of each link, at angles `q` (n, 7), rad, rates
    and accelerations; `gravity` (3,), m/s², in the axes of the base."""
    n, joints = q.shape
    found = np.zeros((n, joints, joints, PARAMETERS))
    turn, spun, place = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3))
    pushed = np.broadcast_to(-gravity, (n, 3))
    turned = hinges(chain, q)
    for link, hinge in enumerate(turned):
        arm = hinge.anchor - place
        pushed = pushed + np.cross(spun, arm) + np.cross(turn, np.cross(turn, arm))
        rate, change = dq[:, link, None], ddq[:, link, None]
        spun = spun + hinge.axis * change + np.cross(turn, hinge.axis) * rate
        turn, place = turn + hinge.axis * rate, hinge.anchor

        def local(vectors: Array, frame: Array = hinge.frame) -> Array:
            return np.einsum("nji,nj->ni", frame, vectors)

        force, moment = _wrench(local(pushed), local(turn), local(spun))
        for joint, before in enumerate(turned[: link + 1]):
            aside = np.cross(before.axis, hinge.anchor - before.anchor)
            found[:, joint, link] = np.einsum("ni,nik->nk", local(aside), force)
            found[:, joint, link] += np.einsum("ni,nik->nk", local(before.axis), moment)
    return found


def _wrench(acceleration: Array, turn: Array, spun: Array) -> tuple[Array, Array]:
    """Force and moment (n, 3, 10) about the anchor by each parameter, in the link's axes."""
    force, moment = np.zeros((2, len(turn), 3, PARAMETERS))
    across = _cross(turn)
    force[:, :, 0] = acceleration
    force[:, :, 1:4] = _cross(spun) + across @ across
    moment[:, :, 1:4] = -_cross(acceleration)
    moment[:, :, 4:] = _momentum(spun) + across @ _momentum(turn)
    return force, moment


def _cross(vectors: Array) -> Array:
    """(n, 3, 3) v × ·."""
    found = np.zeros((len(vectors), 3, 3))
    found[:, (2, 0, 1), (1, 2, 0)] = vectors
    found[:, (1, 2, 0), (2, 0, 1)] = -vectors
    return found


def _momentum(vectors: Array) -> Array:
    """(n, 3, 6) I v by each component of I."""
    found = np.zeros((len(vectors), 3, 6))
    found[:, (0, 1, 2), (0, 1, 2)] = vectors
    found[:, (0, 1), (3, 3)] = vectors[:, (1, 0)]
    found[:, (0, 2), (4, 4)] = vectors[:, (2, 0)]
    found[:, (1, 2), (5, 5)] = vectors[:, (2, 1)]
    return found


def parameters(links: Iterable[Link], anchor: Array) -> Array:
    """(10,) parameters of links that move as one, about an anchor (3,), m, at joint angles 0."""
    found = np.zeros(PARAMETERS)
    for link in links:
        own = [link.mass, 0.0, 0.0, 0.0, *link.inertia]
        found += placed_at(np.array(link.com) - anchor) @ own
    return found


def placed_at(centre: Array) -> Array:
    """(10, 10) parameters by mass, first moment about `centre` (3,), m, and inertia about it (to first order in
    that first moment)."""
    found = np.eye(PARAMETERS)
    found[1:4, 0] = centre
    found[4:, 0] = components(centre @ centre * np.eye(3) - np.outer(centre, centre))
    for axis, unit in enumerate(np.eye(3)):
        both = np.outer(centre, unit)
        found[4:, 1 + axis] = components(2.0 * centre[axis] * np.eye(3) - both - both.T)
    return found


def inertia_about_centre(found: Array) -> Array:
    """(3, 3) kg m², inertia about the centre of mass of parameters (10,)."""
    centre = found[1:4] / found[0]
    away = centre @ centre * np.eye(3) - np.outer(centre, centre)
    return tensor_of(found[4:].tolist()) - found[0] * away
