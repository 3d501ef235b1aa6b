"""How fast an arm may move, from what it weighs where it is and where it goes."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.geometry.pose import Array, Pose
from palpate.robots.nominal import NominalArm
from palpate.robots.pace import free_speed, guided_mass, joint_rate
from palpate.robots.registry import arms, load_description

ARM = load_description()
NOMINAL = NominalArm(ARM, Pose.of((0, 0, 0)), np.zeros(3))
AHEAD, ASIDE, UP = np.eye(3)


def at(x: float, z: float) -> Array:
    return NOMINAL.reach(Pose.top_down((x, 0.0, z), 0.0), ARM.home)


def test_the_arm_is_heavier_downwards_than_ahead_and_lightest_sideways_when_stretched() -> None:
    masses = [guided_mass(NOMINAL, at(0.6, 0.1), direction) for direction in (UP, AHEAD, ASIDE)]
    assert masses == sorted(masses, reverse=True)
    assert 3.0 < masses[2] < 6.0
    assert 9.0 < masses[0] < 18.0


def test_speed_times_mass_is_the_same_impulse_unless_the_pace_is_the_limit() -> None:
    for direction in (-UP, AHEAD):
        mass = guided_mass(NOMINAL, at(0.5, 0.1), direction)
        given = (1 + ARM.pace.restitution) * mass * free_speed(ARM, at(0.5, 0.1), direction)
        assert given == pytest.approx(ARM.pace.impulse)
    assert free_speed(ARM, at(0.7, 0.3), ASIDE) == ARM.pace.speed


def test_the_hands_back_may_be_faster_than_the_fingertips() -> None:
    assert free_speed(ARM, at(0.5, 0.1), UP) > 1.3 * free_speed(ARM, at(0.5, 0.1), -UP)


@pytest.mark.parametrize("name", sorted(arms().folders))
def test_a_cautious_arm_is_slow_everywhere(name: str) -> None:
    arm = arms().load(name)
    nominal = NominalArm(arm, Pose.of((0, 0, 0)), np.zeros(3))
    q = nominal.reach(Pose.top_down((0.5, 0.0, 0.2), 0.0), arm.home)
    for direction in (AHEAD, ASIDE, UP, -UP):
        careful, usual = free_speed(arm.cautious(), q, direction), free_speed(arm, q, direction)
        assert careful <= 0.06
        assert careful < usual / 2
    assert arm.cautious().limits is arm.limits


def test_a_joint_motion_is_as_slow_as_its_heaviest_point_wants() -> None:
    way = np.array([0.6, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    turning, wrist = ARM.home + way, ARM.home + way[::-1]
    assert joint_rate(NOMINAL, ARM.pace, ARM.home, wrist) == pytest.approx(
        ARM.pace.joint_speed / 0.6
    )
    rate = joint_rate(NOMINAL, ARM.pace, ARM.home, turning)
    assert rate < ARM.pace.joint_speed / 0.6
    speed = np.linalg.norm(NOMINAL.jacobian(ARM.home)[:3] @ way) * rate
    assert 0.05 < speed <= ARM.pace.speed
