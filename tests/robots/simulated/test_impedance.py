"""The controller of the simulated arm: the null space is held by MuJoCo alone, however long a run is."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from palpate.common.pose import Array, Pose
from palpate.robots.owner import load_description
from palpate.robots.simulated.robot import MujocoRobot
from palpate.robots.springs import Swivel

ARM = load_description()
TICK = 0.02


def arm() -> MujocoRobot:
    spec = mujoco.MjSpec.from_string("<mujoco><worldbody/></mujoco>")
    return MujocoRobot(spec, Pose.of((0, 0, 0)), ARM)


def gone(ticks: int) -> tuple[Array, Array]:
    """Joint angles (n, 7) on a straight way and after it, and errors (n, 3), m, with so many ticks in a run."""
    robot = arm()
    # Off its posture: the elbow swings back while the TCP goes.
    robot.move_joints(ARM.home + np.array([0.3, -0.2, -0.6, 0.0, 0.2, 0.0, 0.0]))
    robot.advance(2.0)
    assert not robot.state.moving
    robot.drain()
    robot.move_pose(Pose.top_down((0.45, 0.1, 0.4), 0.0), 0.25)
    while robot.state.t < 8.0 - 1e-9:
        robot.run_on(ticks, TICK)
    samples = robot.drain()
    rows = slice(0, round(5.9 / 0.005))
    off = samples.pose_world_tcp[rows, :3] - samples.target_world_tcp[rows, :3]
    return samples.q[rows], off


def test_the_elbow_goes_the_same_way_in_runs_of_a_tick_and_of_four() -> None:
    (q, off), (run_q, run_off) = gone(1), gone(4)
    assert np.abs(q[-1] - q[0]).max() > 0.3
    assert np.abs(run_q - q).max() < 1e-3
    assert np.abs(run_q[-1] - q[-1]).max() < 1e-4
    assert np.abs(run_off - off).max() < 4e-5
    assert np.abs(run_q[-40:] - run_q[-1]).max() < 2e-4  # at rest


@pytest.mark.parametrize("away", [0.1, -2.0])
def test_the_null_space_is_pulled_to_its_posture_without_a_twist(away: float) -> None:
    random = np.random.default_rng(1)
    jacobian, own = random.standard_normal((6, 7)), random.uniform(0.1, 2.0, 7)
    swivel = Swivel.of(jacobian, own)
    assert np.abs(jacobian @ swivel.axis).max() < 1e-7
    assert swivel.axis @ swivel.axis == pytest.approx(1.0)
    pull = swivel.torque(away * np.sign(swivel.axis), np.zeros((1, 7)))[0]
    # 5 rad/s, critically damped, no stronger than half a radian off.
    inertia = own @ swivel.axis**2
    assert swivel.damping == pytest.approx(10.0 * inertia)
    least = np.clip(away, -0.5, 0.5) * (own @ np.abs(swivel.axis))
    assert pull == pytest.approx(25.0 * least)
