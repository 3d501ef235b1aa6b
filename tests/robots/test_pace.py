"""How fast an arm may move, from what it weighs where it is and where it goes."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.common.pose import Array, Pose
from palpate.robots.nominal import NominalArm
from palpate.robots.owner import arms, load_description
from palpate.robots.pace import (
    SHELL,
    contact_speed,
    elbow_speed,
    free_speed,
    free_speeds,
    guided_mass,
    impulse_speed,
    joint_rates,
)

ARM = load_description()
NOMINAL = NominalArm(ARM, Pose.of((0, 0, 0)), np.zeros(3))
AHEAD, ASIDE, UP = np.eye(3)
WRIST = np.array([0.0, 0.0, ARM.reach.wrist])


def at(x: float, z: float) -> Array:
    return NOMINAL.reach(Pose.top_down((x, 0.0, z), 0.0), ARM.home)


def mass(q: Array, direction: Array, offset: Array | None = None) -> float:
    """kg, of the TCP, or of a point beside it."""
    jacobian = NOMINAL.jacobian(q)
    moved = np.zeros(3) if offset is None else offset
    point = jacobian[:3] + np.cross(jacobian[3:].T, moved).T
    return guided_mass(NOMINAL.mass_matrix(q), point, direction)


def test_the_arm_is_heavier_downwards_than_ahead_and_lightest_sideways_when_stretched() -> None:
    masses = [mass(at(0.6, 0.1), direction) for direction in (UP, AHEAD, ASIDE)]
    assert masses == sorted(masses, reverse=True)
    assert 3.0 < masses[2] < 6.0
    assert 9.0 < masses[0] < 18.0


def test_ahead_the_wrist_is_heavier_than_the_fingertips_and_decides() -> None:
    q = at(0.6, 0.1)
    assert mass(q, AHEAD, WRIST) > 2.5 * mass(q, AHEAD)
    given = mass(q, AHEAD, WRIST) * free_speed(NOMINAL, ARM, q, AHEAD)
    assert ARM.pace.impulse / 2 < given < ARM.pace.impulse


def test_downwards_the_fingertips_decide_and_give_no_more_than_the_impulse() -> None:
    q = at(0.5, 0.1)
    given = mass(q, -UP) * free_speed(NOMINAL, ARM, q, -UP)
    assert ARM.pace.impulse / 2 < given < ARM.pace.impulse
    assert free_speed(NOMINAL, ARM, at(0.7, 0.3), ASIDE) > 0.8 * ARM.pace.speed


def test_the_hands_back_may_be_faster_than_the_fingertips() -> None:
    q = at(0.5, 0.1)
    assert free_speed(NOMINAL, ARM, q, UP) > 1.3 * free_speed(NOMINAL, ARM, q, -UP)


def test_contact_speed_is_lower_where_the_arm_is_heavy() -> None:
    near, far = (Pose.top_down((x, 0.0, 0.1), 0.0) for x in (0.35, 0.6))
    assert 0.015 < contact_speed(ARM, near, -UP) < 0.03 < contact_speed(ARM, far, -UP) < 0.06


def test_a_path_has_the_speed_limit_of_each_part() -> None:
    bent = at(0.35, 0.2), at(0.7, 0.2)
    speeds = free_speeds(NOMINAL, ARM, bent, np.array([0.35, 0.0, 0.0]))
    assert len(speeds) == 8
    assert max(speeds) > 1.2 * min(speeds)
    assert all(0.03 < speed <= ARM.pace.speed for speed in speeds)


@pytest.mark.parametrize("name", sorted(arms()))
def test_a_cautious_arm_is_slow_everywhere(name: str) -> None:
    arm = arms().load(name)
    nominal = NominalArm(arm, Pose.of((0, 0, 0)), np.zeros(3))
    q = nominal.reach(Pose.top_down((0.5, 0.0, 0.2), 0.0), arm.home)
    for direction in (AHEAD, ASIDE, UP, -UP):
        careful = free_speed(nominal, arm.cautious(), q, direction)
        assert careful <= 0.06
        assert careful < free_speed(nominal, arm, q, direction) / 2
    assert arm.cautious().limits is arm.limits


def test_a_joint_motion_is_as_slow_as_its_heaviest_point_wants() -> None:
    way = np.array([0.6, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    most = pytest.approx(ARM.pace.joint_speed / 0.6)
    assert joint_rates(NOMINAL, ARM, ARM.home, ARM.home + way[::-1]) == [most] * 8
    rates = joint_rates(NOMINAL, ARM, ARM.home, ARM.home + way)
    assert max(rates) < ARM.pace.joint_speed / 0.6
    speed = np.linalg.norm(NOMINAL.jacobian(ARM.home)[:3] @ way) * max(rates)
    assert 0.05 < speed <= ARM.pace.speed * 1.001


def test_the_elbow_keeps_the_impulse_where_a_slow_hand_makes_it_fast() -> None:
    """A stretched arm that draws its hand in moves the elbow several times faster than the hand."""
    places = np.array([(0.64, -0.34, 0.45), (0.47, -0.3, 0.26)])
    start, end = (NOMINAL.reach(Pose.top_down(place, 0.0), ARM.home) for place in places)
    way = places[1] - places[0]
    length = float(np.linalg.norm(way))
    ahead, rate = way / length, (end - start) / length
    speed = elbow_speed(NOMINAL, ARM, start, ahead, rate)
    assert speed < 0.3 * free_speed(NOMINAL, ARM, start, ahead)
    assert free_speeds(NOMINAL, ARM, (start, end), way)[0] <= speed
    # Momentum of the elbow at the joint rates that move the hand along its line.
    jacobian, mass_matrix = NOMINAL.jacobian(start), NOMINAL.mass_matrix(start)
    missing = np.concatenate([ahead - jacobian[:3] @ rate, np.zeros(3)])
    elbow = NOMINAL.elbow_jacobian()
    velocity = elbow @ (speed * (rate + np.linalg.pinv(jacobian) @ missing))
    along = velocity / np.linalg.norm(velocity)
    carried = 1.0 / (along @ elbow @ np.linalg.solve(mass_matrix, elbow.T) @ along)
    assert np.linalg.norm(velocity) < 1.02 * impulse_speed(ARM.pace, float(carried), SHELL)
