"""Speed limits of an arm, from the impulse that a collision would give.

What decides is momentum: a mass m that is stopped from speed v and comes back with restitution e
gives m (1 + e) v, and a contact takes most of it within some milliseconds, before any reflex. The
mass is the effective one at the place and in the direction of the motion (O. Khatib, "Inertial
Properties in Robotic Manipulation", IJRR 14, 1995).
"""

from __future__ import annotations

import math
from functools import cache
from itertools import pairwise
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

STIFFEST = 1e6
"""N/m of what the arm may run into: steel on a concrete floor. On something softer it is stopped
more gently."""
SHELL = 1e5
"""N/m of the elbow's and the wrist's shells against what hangs above: what is stiffer stands below,
on a table."""
REBOUND = 0.5
"""Restitution of the arm's shells on something as stiff, damped by a fifth of the critical."""
LENGTHWAYS = 0.7
"""Cosine to the tool's axis of motions that the fingertips alone, or the wrist alone, lead: what
stands upright meets the hand's side with no more than the rest of the motion."""
WINDOW = 0.010
"""s, over which the force of a contact is averaged."""
GENTLE = 0.65
"""N s: 65 N in the mean of 10 ms, the lowest quasi-static limit of ISO/TS 15066."""
STILL = 1e-6
"""m on a whole way: the point does not move."""

_LOCK = Lock()


def contact_speed(arm: RobotDescription, pose_base_tcp: Pose, direction: Array) -> float:
    """m/s at which the TCP may meet something at a pose, along the unit `direction` (3,), both in
    the base's axes, with an impulse of `GENTLE`.

    The mass is that of the hand with its orientation held: both fingers on a top do not let it
    turn.
    """
    with _LOCK:
        nominal = _nominal(arm)
        q = nominal.reach(pose_base_tcp, arm.home)
        jacobian = nominal.jacobian(q)
        mobility = jacobian @ np.linalg.solve(nominal.mass_matrix(q), jacobian.T)
    held = np.linalg.inv(mobility + SOFTEST * np.eye(6))[:3, :3]
    return GENTLE / ((1.0 + arm.pace.restitution) * float(direction @ held @ direction))


def configuration(arm: RobotDescription, pose_base_tcp: Pose) -> Array:
    """(7,) rad, the joint angles with which the TCP is at a pose, in the base's axes."""
    with _LOCK:
        return _nominal(arm).reach(pose_base_tcp, arm.home)


def jacobian(arm: RobotDescription, q: Array) -> Array:
    """(6, 7) of the TCP at joint angles `q` (7,), rad, in the base's axes."""
    with _LOCK:
        return _nominal(arm).jacobian(q).copy()


def free_speeds(
    nominal: NominalArm, arm: RobotDescription, bent: tuple[Array, Array], way: Array
) -> list[float]:
    """m/s that the TCP may move through free air in each equal part of the straight `way` (3,), m,
    in the nominal arm's axes; `bent` are the joint angles (7,), rad, at its beginning and end."""
    direction = way / np.linalg.norm(way)
    first, last = bent
    speeds: list[float] = []
    for share in np.linspace(0.0, 1.0, STATIONS).tolist():
        q = first + share * (last - first)
        speeds.append(free_speed(nominal, arm, q, direction))
    return [min(pair) for pair in pairwise(speeds)]


def free_speed(nominal: NominalArm, arm: RobotDescription, q: Array, direction: Array) -> float:
    """m/s that the TCP may move through free air at joint angles `q` (7,), rad, along the unit
    `direction` (3,), in the nominal arm's axes: what leads the hand that way, the fingertips, the
    back of the wrist, or, sideways, all from one to the other, gives no more than the pace's
    impulse."""
    mass_matrix, jacobian, tool = nominal.mass_matrix(q), nominal.jacobian(q), _tool(nominal, q)
    speed = arm.pace.speed
    for behind, stiffness in _leading(arm.reach.wrist, float(direction @ tool)):
        mass = guided_mass(mass_matrix, _point(jacobian, -behind * tool), direction)
        speed = min(speed, _speed(arm.pace, mass, stiffness))
    return speed


def _leading(wrist: float, forwards: float) -> tuple[tuple[float, float], ...]:
    """Points of the hand that may run into something: how far they are behind the TCP, m, and what
    they meet, N/m."""
    if forwards > LENGTHWAYS:
        return ((0.0, STIFFEST),)
    if forwards < -LENGTHWAYS:
        return ((wrist, SHELL),)
    return tuple((share * wrist, STIFFEST) for share in (0.0, 0.5, 1.0))


def guided_mass(mass_matrix: Array, jacobian: Array, direction: Array) -> float:
    """kg, effective mass along a unit `direction` (3,) of a point with its `jacobian` (3, 7) while
    it is kept on its line, as friction at a contact keeps it; its orientation gives way."""
    return float(direction @ np.linalg.inv(_mobility(mass_matrix, jacobian)) @ direction)


def joint_rates(
    nominal: NominalArm, arm: RobotDescription, start: Array, goal: Array
) -> list[float]:
    """1/s, how fast the straight way from `start` to `goal` (7,), rad, may be crossed in each of
    its equal parts: neither the joints nor the fingertips, the wrist nor the elbow exceed there
    what they may do anywhere on it."""
    way = goal - start
    most = arm.pace.joint_speed / max(float(np.abs(way).max()), 1e-6)
    rates: list[float] = []
    for share in np.linspace(0.0, 1.0, STATIONS).tolist():
        rates.append(min(most, _rate(nominal, arm, start + share * way, way)))
    return [min(pair) for pair in pairwise(rates)]


def _rate(nominal: NominalArm, arm: RobotDescription, q: Array, way: Array) -> float:
    """1/s at which the arm may follow `way` (7,), rad, at joint angles `q` (7,)."""
    mass_matrix, tcp = nominal.mass_matrix(q), nominal.jacobian(q)
    wrist = _point(tcp, -arm.reach.wrist * _tool(nominal, q))
    points = ((tcp[:3], STIFFEST), (wrist, STIFFEST), (nominal.elbow_jacobian(), SHELL))
    rate = math.inf
    for point, stiffness in points:
        velocity = point @ way
        size = float(np.linalg.norm(velocity))
        if size > STILL:
            ahead = velocity / size
            mass = 1.0 / float(ahead @ _mobility(mass_matrix, point) @ ahead)
            rate = min(rate, min(arm.pace.speed, _speed(arm.pace, mass, stiffness)) / size)
    return rate


def _tool(nominal: NominalArm, q: Array) -> Array:
    """(3,) the tool's axis, out of the hand, in the nominal arm's axes."""
    return Pose(np.zeros(3), nominal.poses(q[None])[0, 3:]).rotation[:, 2]


def _point(jacobian: Array, offset: Array) -> Array:
    """(3, 7) of a point that is `offset` (3,) m from the TCP, of its `jacobian` (6, 7)."""
    return jacobian[:3] - np.cross(offset, jacobian[3:], axis=0)


def _mobility(mass_matrix: Array, jacobian: Array) -> Array:
    """(3, 3) 1/kg of a point with this `jacobian` (3, 7)."""
    return jacobian @ np.linalg.solve(mass_matrix, jacobian.T) + SOFTEST * np.eye(3)


def _speed(pace: Pace, mass: float, stiffness: float = STIFFEST) -> float:
    """m/s at which a mass, kg, gives no more than the pace's impulse within `WINDOW` to what has
    that `stiffness`, N/m.

    Its contact is half a wave of sin(w t) with w = sqrt(k / m), of which a heavy mass gives only
    the middle within the window.
    """
    angle = min(math.sqrt(stiffness / mass) * WINDOW / 2, math.pi / 2)
    return pace.impulse / ((1.0 + REBOUND) * mass * math.sin(angle))


@cache
def _nominal(arm: RobotDescription) -> NominalArm:
    return NominalArm(arm, Pose.of((0.0, 0.0, 0.0)), np.zeros(3))
