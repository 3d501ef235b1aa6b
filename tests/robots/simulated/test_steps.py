"""Steps of the physics: one to four in a control cycle."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from palpate.geometry.pose import Pose
from palpate.robots.registry import load_description
from palpate.robots.simulated.robot import MujocoRobot

ARM = load_description()
TICK = 0.02


def arm(substeps: int, watched: bool) -> MujocoRobot:
    spec = mujoco.MjSpec.from_string("<mujoco><worldbody/></mujoco>")
    robot = MujocoRobot(spec, Pose.of((0, 0, 0)), ARM, substeps=substeps)
    if watched:
        robot.world.watch = lambda data: None
    return robot


@pytest.mark.parametrize(
    ("substeps", "watched"), [(1, False), (2, False), (2, True), (4, True)], ids=str
)
def test_a_free_motion_measures_no_force_at_steps_of_any_length(
    substeps: int, watched: bool
) -> None:
    robot, most = arm(substeps, watched), 0.0
    robot.move_joints(ARM.home + 0.2)
    while robot.state.moving:
        robot.advance(TICK)
        most = max(most, float(np.linalg.norm(robot.state.contact[:3])))
    assert most < 0.1
