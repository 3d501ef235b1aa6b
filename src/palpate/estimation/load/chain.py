"""Kinematics and inverse dynamics of an arm's chain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.geometry.pose import Array, tensor_of
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


def own_motion(chain: Chain, q: Array, dq: Array, ddq: Array) -> Array:
    """(n, m) N m that move the links of `chain` at joint angles `q` (n, m), rad, rates `dq`, rad/s, and
    accelerations `ddq`, rad/s², without gravity.

    Newton's and Euler's equations from the base out and back again (Featherstone, Rigid Body Dynamics
    Algorithms, 2008, section 5.3), in the axes of the base; velocities and forces are those at the origin
    of the base.
    """
    count = len(q)
    turn, slide, turned, slid = np.zeros((4, count, 3))
    asides: list[tuple[Array, Array]] = []
    moved: list[tuple[Array, Array]] = []
    for joint, hinge in enumerate(hinges(chain, q)):
        axis = hinge.axis
        # Velocity at the origin by a unit rate of the joint.
        aside = np.cross(hinge.anchor, axis)
        rate, change = dq[:, joint, None], ddq[:, joint, None]
        slid = slid + aside * change + (np.cross(turn, aside) + np.cross(slide, axis)) * rate
        turned = turned + axis * change + np.cross(turn, axis) * rate
        turn, slide = turn + axis * rate, slide + aside * rate
        asides.append((axis, aside))
        pose = hinge.frame, hinge.origin
        moved.append(inertial_wrench(chain, joint, pose, (turn, slide), (turned, slid)))
    out, force, moment = np.zeros(q.shape), np.zeros((count, 3)), np.zeros((count, 3))
    for joint in reversed(range(len(asides))):
        force, moment = force + moved[joint][0], moment + moved[joint][1]
        axis, aside = asides[joint]
        out[:, joint] = (axis * moment + aside * force).sum(axis=1)
    return out


def inertial_wrench(
    chain: Chain,
    joint: int,
    pose: tuple[Array, Array],
    speed: tuple[Array, Array],
    change: tuple[Array, Array],
) -> tuple[Array, Array]:
    """Force and moment about the origin, (n, 3) each, that move the links behind a joint."""
    rotation, shift = pose
    turn, slide = speed
    turned, slid = change
    force, moment = np.zeros_like(turn), np.zeros_like(turn)
    for link in chain.links:
        if link.joint != joint:
            continue
        com = rotation @ np.array(link.com) + shift
        passing = slide + np.cross(turn, com)
        pull = link.mass * (slid + np.cross(turned, com) + np.cross(turn, passing))
        tensor = tensor_of(link.inertia)
        spin = tensor_product(rotation, tensor, turn)
        force += pull
        own = tensor_product(rotation, tensor, turned)
        moment += np.cross(com, pull) + own + np.cross(turn, spin)
    return force, moment


def tensor_product(axes: Array, tensor: Array, vectors: Array) -> Array:
    """(n, 3) R I R^T v."""
    inside = np.einsum("nji,nj->ni", axes, vectors) @ tensor
    return np.einsum("nij,nj->ni", axes, inside)
