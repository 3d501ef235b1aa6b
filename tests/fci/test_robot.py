"""A client of the real libfranka, over the network, and the served arm."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from .conftest import RESTS, passed
from .served import Served

franky = pytest.importorskip("franky", reason="franky-control has no wheel for this machine")

HOME = [0.0, -0.785398, 0.0, -2.356194, 0.0, 1.570796, 0.785398]
BY = np.array([0.05, 0.04, -0.05, 0.06, 0.03, -0.05, 0.08])


def test_a_robot_at_rest_says_where_it_is_and_what_it_carries(robot: Any) -> None:
    robot.move(franky.JointMotion(HOME))
    state = passed(robot, RESTS)
    assert state.robot_mode == franky.RobotMode.Idle
    assert str(state.current_errors) == "[]"
    assert state.q == pytest.approx(HOME, abs=2e-3)
    assert state.m_ee == pytest.approx(0.76)
    assert state.elbow.joint_3_pos == pytest.approx(state.q[2])
    assert np.abs(state.tau_ext_hat_filtered).max() < 0.3


def test_libfrankas_own_model_of_the_urdf_is_the_servers(robot: Any) -> None:
    """Poses and gravity of pinocchio against MuJoCo's, which made the state."""
    robot.move(franky.JointMotion((np.array(HOME) + BY).tolist()))
    state = passed(robot, RESTS)
    pose = robot.model.pose(franky.Frame.EndEffector, state)
    assert pose.translation == pytest.approx(state.O_T_EE.translation, abs=1e-6)
    assert abs(float(pose.quaternion @ state.O_T_EE.quaternion)) == pytest.approx(1.0, abs=1e-9)
    looks = [passed(robot, 0.01) for _ in range(20)]
    compensated = [np.array(look.tau_J) - look.tau_ext_hat_filtered for look in looks]
    gravity = robot.model.gravity(state)
    assert np.mean(compensated, axis=0) == pytest.approx(np.array(gravity), abs=0.25)


def test_a_joint_motion_arrives(robot: Any, bench: Served) -> None:
    before = bench.ask("counts")
    goal = np.array(HOME) - BY
    robot.move(franky.JointMotion(goal.tolist()))
    after = bench.ask("counts")
    assert np.array(passed(robot, RESTS).q) == pytest.approx(goal, abs=1e-3)
    assert after["lost"] == before["lost"]
    assert after["commanded"] - before["commanded"] > 100


def test_a_cartesian_motion_arrives(robot: Any) -> None:
    start = robot.state.O_T_EE
    down = franky.Affine([0.0, 0.02, -0.03])
    robot.move(franky.CartesianMotion(down, franky.ReferenceType.Relative))
    way = start.inverse * robot.state.O_T_EE
    assert way.translation == pytest.approx([0.0, 0.02, -0.03], abs=1e-3)


def test_torques_track_a_reference_in_lockstep(robot: Any, bench: Served) -> None:
    """Time stands still while the client does; no cycle is lost on a busy machine."""
    before, start = bench.ask("counts"), robot.state.O_T_EE
    motion = franky.CartesianImpedanceTrackingMotion(1500, 100)
    robot.move(motion, asynchronous=True)
    place = start.translation + np.array([0.0, 0.0, 0.02])
    motion.set_reference(
        franky.CartesianReference(franky.Affine(place, start.quaternion), franky.Twist())
    )
    state = passed(robot, 0.5)
    assert state.O_T_EE.translation == pytest.approx(place, abs=4e-3)
    assert state.robot_mode == franky.RobotMode.Move
    assert state.control_command_success_rate == 1.0
    robot.stop()
    with pytest.raises(franky.ControlException, match="preempted"):
        robot.join_motion()
    assert bench.ask("counts")["lost"] == before["lost"]
