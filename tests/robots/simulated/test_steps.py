"""Steps of the physics: one a control cycle while the arm alone moves, two while anything touches."""

from __future__ import annotations

from unittest.mock import patch

import mujoco
import numpy as np
import pytest

from palpate.common.pose import Pose
from palpate.robots.owner import load_description
from palpate.robots.simulated.guard import Guard
from palpate.robots.simulated.robot import MujocoRobot
from palpate.robots.simulated.world import Steps, World

ARM = load_description()
TICK = 0.02
BLOCK = '<geom name="block" type="box" pos="0.5 0 0.2" size="0.1 0.1 0.2"/>'
BALL = '<body pos="0.5 0.6 0.8"><freejoint/><geom size="0.02" mass="0.1"/></body>'
ABOVE = Pose.top_down((0.5, 0.0, 0.415), 0.0)


def arm(inside: str = "", substeps: int = 2, watched: bool = False) -> MujocoRobot:
    spec = mujoco.MjSpec.from_string(f"<mujoco><worldbody>{inside}</worldbody></mujoco>")
    robot = MujocoRobot(spec, Pose.of((0, 0, 0)), ARM, substeps=substeps)
    if watched:
        robot.world.watch = lambda data: None
    return robot


def stepped(robot: MujocoRobot, ticks: int) -> list[float]:
    """Length of the physics steps in each run, ms."""
    lengths: list[float] = []
    step = World.step

    def noted(world: World, control: np.ndarray, guard: Guard) -> Steps:
        steps = step(world, control, guard)
        lengths.append(round(1e3 * steps.step, 6))
        return steps

    with patch.object(World, "step", noted):
        for _ in range(ticks):
            robot.advance(TICK)
    return lengths


@pytest.mark.parametrize(
    ("substeps", "watched"), [(1, False), (2, False), (2, True), (4, True)], ids=str
)
def test_a_free_motion_measures_no_force_at_steps_of_any_length(
    substeps: int, watched: bool
) -> None:
    robot, most = arm("", substeps, watched), 0.0
    robot.move_joints(ARM.home + 0.2)
    while robot.state.moving:
        robot.advance(TICK)
        most = max(most, float(np.linalg.norm(robot.state.contact[:3])))
    assert most < 0.1


def test_steps_are_finer_while_anything_touches() -> None:
    robot, fine = arm(BLOCK), arm(BLOCK, watched=True)
    for one in (robot, fine):
        one.move_pose(ABOVE, 0.2)
    assert set(stepped(robot, 130)) == {1.0}
    assert set(stepped(fine, 130)) == {0.5}
    for one in (robot, fine):
        one.move_axis(np.array([0.0, 0.0, -1.0]), 0.02, 0.012)
    lengths, _ = stepped(robot, 60), stepped(fine, 60)
    assert lengths == sorted(lengths, reverse=True)
    assert set(lengths) == {1.0, 0.5}
    assert robot.state.contact[2] < -5.0
    assert robot.state.contact[:3] == pytest.approx(fine.state.contact[:3], abs=0.1)
    assert robot.world.model.opt.timestep == pytest.approx(5e-4)


def test_steps_are_finer_while_something_falls() -> None:
    robot = arm(BALL)
    assert set(stepped(robot, 15)) == {0.5}


def test_a_world_is_settled_when_nothing_but_the_arm_moves() -> None:
    box = '<body pos="0.5 0.6 {z}"><freejoint/><geom type="box" size=".03 .03 .03" mass="0.1"/></body>'
    floor = '<geom type="plane" size="2 2 .1"/>'
    robot = arm(floor + box.format(z=0.25))
    robot.advance(0.1)
    assert not robot.world.is_settled
    robot.advance(1.0)
    assert robot.world.is_settled
    lying = robot.world.qpos
    robot.move_joints(ARM.home + 0.1)
    robot.advance(1.0)
    assert robot.world.is_settled
    assert np.abs(robot.world.qpos - lying)[:7].max() == 0.0
