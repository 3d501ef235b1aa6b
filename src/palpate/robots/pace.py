"""How fast an arm may move: what it would do to a thing that it runs into.

What decides is momentum: a mass m that is stopped from speed v and comes back with restitution e
gives m (1 + e) v, and a contact takes most of it within some milliseconds, before any reflex. The
mass is the effective one at the place and in the direction of the motion (O. Khatib, "Inertial
Properties in Robotic Manipulation", IJRR 14, 1995).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache
from threading import Lock

import numpy as np

from palpate.geometry.pose import Array, Pose
from palpate.robots.description import RobotDescription
from palpate.robots.nominal import NominalArm
from palpate.robots.sheet import Pace

STATIONS = 9
"""Places on a joint motion's way at which its speed is judged."""
SOFTEST = 1e-3
"""1/kg added to a mobility: what has more than 1000 kg does not move there."""

LINK_STIFFNESS = 1e5
"""N/m of a link's shell against what it meets."""
BACKWARDS = -0.7
"""Cosine to the tool's axis of motions that the hand's back leads."""
WINDOW = 0.01
"""s, over which the force of a contact is averaged."""
GENTLE = 0.65
"""N s: 65 N in the mean of 10 ms, the lowest quasi-static limit of ISO/TS 15066."""
STILL = 1e-6
"""m on a whole way: the point does not move."""

_LOCK = Lock()


def free_speed(arm: RobotDescription, q: Array, direction: Array) -> float:
    """m/s, the fastest that the TCP may move through free air at joint angles `q` (7,), rad, along
    the unit `direction` (3,) in the base's axes."""
    with _LOCK:
        return speed_along(_nominal(arm), arm.pace, [q], direction)


def contact_speed(arm: RobotDescription, q: Array, direction: Array) -> float:
    """m/s at which the TCP may meet something at joint angles `q` (7,), rad, along the unit
    `direction` (3,) in the base's axes, with an impulse of `GENTLE`.

    The mass is that of the hand with its orientation held: both fingers on a top do not let it
    turn.
    """
    with _LOCK:
        nominal = _nominal(arm)
        jacobian = nominal.jacobian(q)
        mobility = jacobian @ np.linalg.solve(nominal.mass_matrix(q), jacobian.T)
    held = np.linalg.inv(mobility + SOFTEST * np.eye(6))[:3, :3]
    return GENTLE / ((1.0 + arm.pace.restitution) * float(direction @ held @ direction))


def jacobian(arm: RobotDescription, q: Array) -> Array:
    """(6, 7) of the TCP at joint angles `q` (7,), rad, in the base's axes."""
    with _LOCK:
        return _nominal(arm).jacobian(q).copy()


def speed_along(
    nominal: NominalArm, pace: Pace, configurations: Sequence[Array], direction: Array
) -> float:
    """m/s that the TCP may move along the unit `direction` (3,), in the nominal arm's axes, where
    it passes through `configurations` (7,) each."""
    allowed = [_allowed(nominal, pace, q, direction) for q in configurations]
    return min(pace.speed, *allowed)


def _allowed(nominal: NominalArm, pace: Pace, q: Array, direction: Array) -> float:
    """m/s at one configuration. Backwards no fingers lead, but the hand and the links."""
    mass = guided_mass(nominal, q, direction)
    tool = Pose(np.zeros(3), nominal.poses(q[None])[0, 3:]).rotation[:, 2]
    return _link_speed(pace, mass) if direction @ tool < BACKWARDS else _speed(pace, mass)


def guided_mass(nominal: NominalArm, q: Array, direction: Array) -> float:
    """kg, effective mass of the TCP along a unit `direction` (3,) while it is kept on its line, as
    friction at a contact keeps it; its orientation gives way."""
    mobility = _mobility(nominal.mass_matrix(q), nominal.jacobian(q)[:3])
    return float(direction @ np.linalg.inv(mobility) @ direction)


def joint_rate(nominal: NominalArm, pace: Pace, start: Array, goal: Array) -> float:
    """1/s, how fast the straight way from `start` to `goal` (7,), rad, may be crossed: neither the
    joints nor the TCP nor the elbow exceed what they may do anywhere on it."""
    way = goal - start
    rate = pace.joint_speed / max(float(np.abs(way).max()), 1e-6)
    for share in np.linspace(0.0, 1.0, STATIONS).tolist():
        q = start + share * way
        mass_matrix, tcp = nominal.mass_matrix(q), nominal.jacobian(q)[:3]
        rate = min(rate, _rate(pace, mass_matrix, tcp, way, _speed))
        rate = min(rate, _rate(pace, mass_matrix, nominal.elbow_jacobian(), way, _link_speed))
    return rate


def _rate(
    pace: Pace,
    mass_matrix: Array,
    jacobian: Array,
    way: Array,
    speed: Callable[[Pace, float], float],
) -> float:
    """1/s at which one point of the arm, with its `jacobian` (3, 7), may follow `way` (7,);
    `speed` is what its effective mass allows."""
    velocity = jacobian @ way
    size = float(np.linalg.norm(velocity))
    if size < STILL:
        return math.inf
    direction = velocity / size
    mass = 1.0 / float(direction @ _mobility(mass_matrix, jacobian) @ direction)
    return min(pace.speed, speed(pace, mass)) / size


def _mobility(mass_matrix: Array, jacobian: Array) -> Array:
    """(3, 3) 1/kg of a point with this `jacobian` (3, 7)."""
    return jacobian @ np.linalg.solve(mass_matrix, jacobian.T) + SOFTEST * np.eye(3)


def _speed(pace: Pace, mass: float) -> float:
    """m/s at which a mass, kg, gives no more than the pace's impulse: at the TCP, where hard pads
    meet hard things."""
    return pace.impulse / ((1.0 + pace.restitution) * mass)


def _link_speed(pace: Pace, mass: float) -> float:
    """m/s at which a heavy mass, kg, is stopped without more than the mean force of that impulse:
    it takes longer than `WINDOW`, and the peak is v sqrt(k m)."""
    return pace.impulse / WINDOW / math.sqrt(LINK_STIFFNESS * mass)


@cache
def _nominal(arm: RobotDescription) -> NominalArm:
    return NominalArm(arm, Pose.of((0.0, 0.0, 0.0)), np.zeros(3))
