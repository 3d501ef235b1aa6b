"""The arm runs on by itself until something happens."""

from __future__ import annotations

from dataclasses import fields

import mujoco
import numpy as np
import pytest

from palpate.common.pose import Pose
from palpate.primitives.contact import CONTACT_FORCE
from palpate.robots.owner import load_description
from palpate.robots.simulated.robot import MujocoRobot
from palpate.robots.watched import Watched

ARM = load_description()
TICK = 0.02
POST = '<body><geom name="post" type="capsule" fromto="0.5 0 0 0.5 0 0.3" size="0.03"/></body>'


def arm(bodies: str = "", noise: str = "none") -> MujocoRobot:
    spec = mujoco.MjSpec.from_string(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    return MujocoRobot(spec, Pose.of((0, 0, 0)), ARM, noise=noise, seed=1)


def passed(robot: MujocoRobot, ticks: int) -> int:
    """Ticks of a run on."""
    before = robot.state.t
    robot.run_on(ticks, TICK)
    return round((robot.state.t - before) / TICK)


def test_nothing_happens_to_an_arm_at_rest() -> None:
    robot = arm()
    robot.advance(0.5)
    assert passed(robot, 4) == 4
    assert passed(robot, 7) == 7


@pytest.mark.parametrize("ticks", [2, 3, 4, 9])
def test_a_block_ends_with_the_tick_in_which_the_motion_ends(ticks: int) -> None:
    one, other = arm(), arm()
    for robot in (one, other):
        robot.move_joints(ARM.home + 0.1)
    while one.state.moving:
        one.advance(TICK)
    while other.state.moving:
        assert 1 <= passed(other, ticks) <= ticks
    assert other.state.t == pytest.approx(one.state.t, abs=1e-9)
    assert np.abs(other.state.q - one.state.q).max() < 2e-5


def test_a_block_ends_with_the_motion_of_the_fingers() -> None:
    one, other = arm(), arm()
    for robot in (one, other):
        robot.close_gripper()
    while one.state.gripper_moving:
        one.advance(TICK)
    while other.state.gripper_moving:
        passed(other, 4)
    assert one.state.t <= other.state.t <= one.state.t + TICK + 1e-9


@pytest.mark.parametrize("noise", ["none", "measured"])
def test_a_block_ends_at_a_contact(noise: str) -> None:
    """A probe meets a post, and the arm says so before it presses as hard as a contact."""
    robot = arm(POST, noise)
    robot.move_pose(Pose.top_down((0.5, 0.0, 0.35), 0.0), 0.2)
    while robot.state.moving:
        robot.advance(TICK)
    robot.advance(0.5)
    robot.move_axis(np.array([0.0, 0.0, -1.0]), 0.012, 0.1)
    robot.advance(0.5)
    free, pressed = robot.state.contact[2], 0.0
    while pressed < 3.0:
        robot.run_on(4, TICK)
        pressed = free - robot.state.contact[2]
        assert robot.state.moving
    assert pressed < CONTACT_FORCE
    assert [passed(robot, 4) for _ in range(3)] == [1, 1, 1]


def test_a_block_ends_with_the_reflex() -> None:
    robot = arm(POST)
    robot.set_reflex(ARM.limits.reflexes.free)
    robot.move_pose(Pose.top_down((0.5, 0.0, 0.2), 0.0), 0.1)
    while robot.state.reflex is None:
        assert robot.state.moving
        robot.run_on(4, TICK)
    fired = robot.state.t
    assert passed(robot, 4) <= 2  # while it gives way
    assert robot.state.t > fired


class _Own:
    """A robot whose time passes by itself."""

    def __init__(self, robot: MujocoRobot) -> None:
        self._robot = robot

    def __getattr__(self, name: str) -> object:
        if name == "run_on":
            raise AttributeError(name)
        return getattr(self._robot, name)


def test_other_robots_are_looked_at_every_tick() -> None:
    robot = Watched(_Own(arm()), ARM)  # type: ignore[arg-type]
    robot.run_on(4, TICK)
    assert robot.state.t == pytest.approx(TICK)


def test_samples_do_not_depend_on_the_length_of_a_block() -> None:
    one, other = arm(), arm()
    for robot in (one, other):
        robot.move_joints(ARM.home + 0.2)
        robot.advance(TICK)
        robot.drain()
    for _ in range(4):
        one.advance(2 * TICK)
    for _ in range(2):
        other.run_on(4, TICK)
    ours, theirs = one.drain(), other.drain()
    for signal in fields(ours):
        apart = np.abs(getattr(ours, signal.name) - getattr(theirs, signal.name)).max(initial=0.0)
        assert apart < 1e-9, signal.name
