"""What an arm's own links take to be moved, as far as they are known."""

from __future__ import annotations

import numpy as np

from palpate.geometry.inertia import tensor_of
from palpate.geometry.pose import Array
from palpate.trace.recording import Chain


def own_motion(chain: Chain, q: Array, dq: Array, ddq: Array) -> Array:
    """(n, m) N m that move the links of `chain` at joint angles `q` (n, m), rad, rates `dq`, rad/s, and
    accelerations `ddq`, rad/s², on top of what carries them.

    Newton's and Euler's equations from the base out and back again (Featherstone, Rigid Body Dynamics
    Algorithms, 2008, section 5.3), in the base's axes; of velocities and forces, what they are at the
    base's origin.
    """
    count = len(q)
    rotation, shift = np.broadcast_to(np.eye(3), (count, 3, 3)), np.zeros((count, 3))
    turn, slide, turned, slid = np.zeros((4, count, 3))
    hinges: list[tuple[Array, Array]] = []
    moved: list[tuple[Array, Array]] = []
    for joint, (own, place) in enumerate(zip(chain.axes, chain.anchors, strict=True)):
        axis = rotation @ np.array(own)
        anchor = rotation @ np.array(place) + shift
        # What a turn about the hinge does at the origin.
        aside = np.cross(anchor, axis)
        rate, change = dq[:, joint, None], ddq[:, joint, None]
        slid = slid + aside * change + (np.cross(turn, aside) + np.cross(slide, axis)) * rate
        turned = turned + axis * change + np.cross(turn, axis) * rate
        turn, slide = turn + axis * rate, slide + aside * rate
        rotation = rotation @ about(np.array(own), q[:, joint])
        shift = anchor - rotation @ np.array(place)
        hinges.append((axis, aside))
        moved.append(_taken(chain, joint, (rotation, shift), (turn, slide), (turned, slid)))
    out, force, moment = np.zeros(q.shape), np.zeros((count, 3)), np.zeros((count, 3))
    for joint in reversed(range(len(hinges))):
        force, moment = force + moved[joint][0], moment + moved[joint][1]
        axis, aside = hinges[joint]
        out[:, joint] = (axis * moment + aside * force).sum(axis=1)
    return out


def _taken(
    chain: Chain,
    joint: int,
    pose: tuple[Array, Array],
    speed: tuple[Array, Array],
    change: tuple[Array, Array],
) -> tuple[Array, Array]:
    """Force and moment about the origin, (n, 3) each, that the links behind a joint take to move."""
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
        axes, tensor = rotation, tensor_of(link.inertia)
        spin = _within(axes, tensor, turn)
        force += pull
        moment += np.cross(com, pull) + _within(axes, tensor, turned) + np.cross(turn, spin)
    return force, moment


def _within(axes: Array, tensor: Array, vectors: Array) -> Array:
    """(n, 3) R I R^T v."""
    inside = np.einsum("nji,nj->ni", axes, vectors) @ tensor
    return np.einsum("nij,nj->ni", axes, inside)


def about(axis: Array, angle: Array) -> Array:
    """(k, 3, 3) rotations by `angle` (k,) about a unit `axis` (3,), by Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, cosine = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + sine * cross + (1.0 - cosine) * (cross @ cross)
