"""Inverse dynamics of the arm's own links, without gravity."""

from __future__ import annotations

import numpy as np

from palpate.estimation.load.hinges import hinges
from palpate.geometry.pose import Array, tensor_of
from palpate.trace.recording import Chain


def own_motion(chain: Chain, q: Array, dq: Array, ddq: Array) -> Array:
    """(n, m) N m that move the links of `chain` at joint angles `q` (n, m), rad, rates `dq`, rad/s, and
    accelerations `ddq`, rad/s², on top of what carries them.

    Newton's and Euler's equations from the base out and back again (Featherstone, Rigid Body Dynamics
    Algorithms, 2008, section 5.3), in the base's axes; of velocities and forces, what they are at the
    base's origin.
    """
    count = len(q)
    turn, slide, turned, slid = np.zeros((4, count, 3))
    asides: list[tuple[Array, Array]] = []
    moved: list[tuple[Array, Array]] = []
    for joint, hinge in enumerate(hinges(chain, q)):
        axis = hinge.axis
        # What a turn about the hinge does at the origin.
        aside = np.cross(hinge.anchor, axis)
        rate, change = dq[:, joint, None], ddq[:, joint, None]
        slid = slid + aside * change + (np.cross(turn, aside) + np.cross(slide, axis)) * rate
        turned = turned + axis * change + np.cross(turn, axis) * rate
        turn, slide = turn + axis * rate, slide + aside * rate
        asides.append((axis, aside))
        pose = hinge.frame, hinge.origin
        moved.append(_taken(chain, joint, pose, (turn, slide), (turned, slid)))
    out, force, moment = np.zeros(q.shape), np.zeros((count, 3)), np.zeros((count, 3))
    for joint in reversed(range(len(asides))):
        force, moment = force + moved[joint][0], moment + moved[joint][1]
        axis, aside = asides[joint]
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
