"""Kinematics and inverse dynamics of an arm's chain."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.estimation.rigid import (
    PARAMETERS,
    body_wrench,
    in_axes,
    parameters,
    placed_at,
    wrench_columns,
)
from palpate.geometry.pose import Array
from palpate.trace.recording import Chain


@dataclass(frozen=True, slots=True, eq=False)
class Hinge:
    """A joint at k configurations, in the axes of the base.

    Attributes:
        axis, anchor: (k, 3) unit, m.
        frame, origin: (k, 3, 3) and (k, 3) m, of the link that moves with it; at angles 0 those of the base.
    """

    axis: Array
    anchor: Array
    frame: Array
    origin: Array


def hinges(chain: Chain, q: Array) -> list[Hinge]:
    """Joints at angles `q` (k, m), rad, from the base on: a product of exponentials (Lynch and Park, Modern
    Robotics, 2017, chapter 4)."""
    found: list[Hinge] = []
    frame, origin = np.broadcast_to(np.eye(3), (len(q), 3, 3)), np.zeros((len(q), 3))
    for own, place, angle in zip(chain.axes, chain.anchors, q.T, strict=True):
        # Each axis is turned by all joints before it.
        axis, anchor = np.dot(frame, own), np.dot(frame, place) + origin
        frame = frame @ about(np.array(own), angle)
        origin = anchor - np.dot(frame, place)
        found.append(Hinge(axis, anchor, frame, origin))
    return found


def about(axis: Array, angle: Array) -> Array:
    """(k, 3, 3) rotations by `angle` (k,) about a unit `axis` (3,), by Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, cosine = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + sine * cross + (1.0 - cosine) * (cross @ cross)


def tool_kinematics(chain: Chain, q: Array) -> tuple[Array, Array, Array]:
    """TCP (k, 3), tool (k, 3, 3) and Jacobian (k, 6, m) about the TCP at angles `q` (k, m), in the axes of
    the base. The columns of the Jacobian are the twists of the joints (Lynch and Park, chapter 5)."""
    turned = hinges(chain, q)
    last = turned[-1]
    tcp = last.frame @ np.array(chain.tcp) + last.origin
    columns: list[Array] = []
    for hinge in turned:
        about_tcp = np.cross(hinge.axis, tcp - hinge.anchor)
        columns.append(np.concatenate([about_tcp, hinge.axis], axis=1))
    return tcp, last.frame @ np.array(chain.tool), np.stack(columns, axis=2)


def regressor(chain: Chain, q: Array, dq: Array, ddq: Array, gravity: Array) -> Array:
    """(n, m, m, 10) joint torques by a unit of each parameter (`estimation.rigid`) of each joint's link, about its
    anchor, in axes that are those of the base at angles 0.

    Args:
        q, dq, ddq: (n, m) rad, rad/s, rad/s².
        gravity: (3,) m/s², or (n, 3), in the axes of the base.
    """
    found = np.zeros((*q.shape, q.shape[1], PARAMETERS))
    for link, (motions, wrench) in enumerate(link_wrenches(chain, q, dq, ddq, gravity)):
        found[:, : link + 1, link] = motions @ wrench
    return found


def own_motion(
    chain: Chain, q: Array, dq: Array, ddq: Array, gravity: Array | None = None
) -> Array:
    """(n, m) N m that move the links of `chain`, without gravity by default; arguments as in `regressor`."""
    pull = np.zeros(3) if gravity is None else gravity
    turned, found = hinges(chain, q), np.zeros(q.shape)
    moved = list(link_motions(turned, dq, ddq, pull))
    force, moment, tip = np.zeros((3, len(q), 3))
    # From the tip in: the wrench of a link and of all after it, about its anchor.
    for link, (hinge, motion) in reversed(list(enumerate(zip(turned, moved, strict=True)))):
        local = (np.einsum("nji,nj->ni", hinge.frame, each) for each in motion)
        wrench = body_wrench(link_parameters(chain, link), *local)
        own, about_anchor = (np.einsum("nij,nj->ni", hinge.frame, each) for each in wrench)
        moment = moment + about_anchor + np.cross(tip - hinge.anchor, force)
        force, tip = force + own, hinge.anchor
        found[:, link] = np.vecdot(hinge.axis, moment)
    return found


def load_torques(chain: Chain, q: Array, dq: Array, ddq: Array, gravity: Array) -> Array:
    """(n, m, 10) joint torques of a load on the hand, by a unit of each of its parameters about the TCP, in the axes
    of the tool; arguments as in `regressor`."""
    *_, (motions, wrench) = link_wrenches(chain, q, dq, ddq, gravity)
    return motions @ wrench @ tool_parameters(chain)


def tool_parameters(chain: Chain) -> Array:
    """(10, 10) parameters of the last joint's link by those about the TCP, in the axes of the tool."""
    place = placed_at(np.array(chain.tcp) - chain.anchors[-1])
    return place @ in_axes(np.array(chain.tool))


def link_parameters(chain: Chain, joint: int) -> Array:
    """(10,) parameters of all links that move with a joint, about its anchor."""
    links = (link for link in chain.links if link.joint == joint)
    return parameters(links, np.array(chain.anchors[joint]))


def link_wrenches(
    chain: Chain, q: Array, dq: Array, ddq: Array, gravity: Array
) -> Iterator[tuple[Array, Array]]:
    """Of each joint's link, in its own axes about its anchor: (n, j, 6) the twists of the joints up to it, and
    (n, 6, 10) the wrench that moves it, per unit of each of its parameters; from the base out (Khalil and Dombre,
    Modeling, Identification and Control of Robots, 2002, chapters 9 and 12)."""
    turned = hinges(chain, q)
    axes, anchors = (
        np.array([getattr(one, name) for one in turned]) for name in ("axis", "anchor")
    )
    moved = link_motions(turned, dq, ddq, gravity)
    for link, (hinge, motion) in enumerate(zip(turned, moved, strict=True)):
        before = slice(link + 1)
        asides = np.cross(axes[before], hinge.anchor - anchors[before])
        motions = np.stack([asides, axes[before]])
        local = np.einsum("nji,cbnj->nbci", hinge.frame, motions).reshape(len(q), link + 1, 6)
        own = (np.einsum("nji,nj->ni", hinge.frame, each) for each in motion)
        yield local, wrench_columns(*own)


def link_motions(
    turned: Sequence[Hinge], dq: Array, ddq: Array, gravity: Array
) -> Iterator[tuple[Array, Array, Array]]:
    """Of each joint's link: (n, 3) acceleration of its anchor less gravity, its rate, and the change of that, in the
    axes of the base."""
    turn, spun, place = np.zeros((3, len(dq), 3))
    pulled = np.broadcast_to(-gravity, (len(dq), 3))
    for link, hinge in enumerate(turned):
        arm = hinge.anchor - place
        pulled = pulled + np.cross(spun, arm) + np.cross(turn, np.cross(turn, arm))
        rate, change = dq[:, link, None], ddq[:, link, None]
        spun = spun + hinge.axis * change + np.cross(turn, hinge.axis) * rate
        turn, place = turn + hinge.axis * rate, hinge.anchor
        yield pulled, turn, spun
