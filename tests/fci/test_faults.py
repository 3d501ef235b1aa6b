"""What goes wrong with an arm, as a client of the real libfranka meets it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from .conftest import RESTS, connected, fresh, mean_force, passed
from .served import Served, files, served

franky = pytest.importorskip("franky", reason="franky-control has no wheel for this machine")

DOWN = np.array([0.0, 0.0, -1.0])
SPEED = 0.01
"""m/s towards a table."""
HANGS = 10.0
"""s by which what should be so at once is not so for good; a busy machine may take some of them."""


HOME = [0.0, -0.785398, 0.0, -2.356194, 0.0, 1.570796, 0.785398]

OVER_TABLE = [-0.0, 0.092, 0.0, -2.783, -0.0, 2.875, 0.785]
"""rad: the fingertips 7 mm above it."""


@pytest.fixture
def client(bench: Served) -> Iterator[Any]:
    """A connected client; whatever is done to the arm is undone."""
    robot = connected(bench)
    robot.move(franky.JointMotion(HOME))
    yield robot
    bench.ask("user_stop", pressed=False)
    bench.ask("brakes", closed=False)
    bench.ask("lose", share=0.0)
    bench.ask("end_effector", mass=0.76)
    bench.ask("freeze", frozen=False)
    bench.ask("recover")


def tracking(robot: Any, stiffness: float = 1500.0) -> Any:
    """A motion under way that holds the arm where it is."""
    here = robot.state.O_T_EE
    motion = franky.CartesianImpedanceTrackingMotion(stiffness, 100.0)
    robot.move(motion, asynchronous=True)
    motion.set_reference(franky.CartesianReference(here, franky.Twist()))
    passed(robot, 0.02)
    return motion


def failure(robot: Any, seconds: float = 5.0) -> str:
    """What a motion ended with."""
    with pytest.raises(franky.ControlException) as ended:
        assert robot.join_motion(seconds), "it goes on"
    return str(ended.value)


def test_a_reflex_ends_a_motion_until_somebody_recovers(client: Any, bench: Served) -> None:
    tracking(client)
    bench.ask("reflex")
    assert "cartesian_reflex" in failure(client)
    state = client.state
    assert state.robot_mode == franky.RobotMode.Reflex
    assert state.current_errors.cartesian_reflex
    with pytest.raises(franky.CommandException, match="Reflex"):
        client.set_collision_behavior(60.0, 60.0)
    assert client.recover_from_errors()
    assert client.state.robot_mode == franky.RobotMode.Idle
    client.move(franky.JointMotion(HOME))


def test_a_contact_beyond_the_clients_threshold_is_a_reflex(client: Any, bench: Served) -> None:
    """The force is felt as what the robot exerts, and stays near the threshold."""
    client.set_collision_behavior(60.0, 15.0)
    client.move(franky.JointMotion(OVER_TABLE))
    motion = tracking(client)
    start, began = client.state.O_T_EE, client.state.time.to_sec()
    forces: list[float] = []
    while client.is_in_control:
        state = client.state
        place = start.translation + SPEED * (state.time.to_sec() - began) * DOWN
        motion.set_reference(
            franky.CartesianReference(franky.Affine(place, start.quaternion), franky.Twist())
        )
        forces.append(state.O_F_ext_hat_K[2])
        time.sleep(0.001)
    assert "cartesian_reflex" in failure(client)
    assert min(forces) < -8.0
    assert 10.0 < bench.ask("counts")["peak"] < 60.0
    assert client.recover_from_errors()
    assert abs(passed(client, RESTS).O_F_ext_hat_K[2]) < 15.0


def test_a_user_stop_in_motion_is_reported_and_at_rest_only_shown(
    client: Any, bench: Served
) -> None:
    bench.ask("user_stop", pressed=True)
    _until(client, franky.RobotMode.UserStopped)
    assert str(client.state.current_errors) == "[]"
    bench.ask("user_stop", pressed=False)
    _until(client, franky.RobotMode.Idle)
    tracking(client)
    bench.ask("user_stop", pressed=True)
    assert "User Stop pressed" in failure(client)
    with pytest.raises(franky.CommandException):
        client.recover_from_errors()


def test_lost_commands_are_counted_and_tolerated(client: Any, bench: Served) -> None:
    tracking(client)
    bench.ask("lose", share=0.2)
    passed(client, 0.5)
    assert 0.6 < client.state.control_command_success_rate < 0.95
    bench.ask("lose", share=1.0)
    assert "communication_constraints_violation" in failure(client)


def test_torques_that_jump_are_refused(client: Any) -> None:
    place = client.state.O_T_EE.translation + 0.05 * DOWN
    motion = franky.CartesianImpedanceTrackingMotion(1500, 100, max_delta_tau=20.0)
    client.move(motion, asynchronous=True)
    client_reference = franky.CartesianReference(
        franky.Affine(place, client.state.O_T_EE.quaternion), franky.Twist()
    )
    motion.set_reference(client_reference)
    assert "controller_torque_discontinuity" in failure(client)


def test_the_end_effector_set_in_desk_is_reported_and_compensated(
    client: Any, bench: Served
) -> None:
    passed(client, RESTS)
    before = mean_force(client)
    bench.ask("end_effector", mass=0.56)
    assert passed(client, RESTS).m_ee == pytest.approx(0.56)
    assert mean_force(client) - before == pytest.approx([0.0, 0.0, 0.2 * 9.81], abs=0.15)


def _until(robot: Any, mode: Any) -> None:
    end = time.monotonic() + HANGS
    while robot.state.robot_mode != mode:
        assert time.monotonic() < end, "the mode did not change"


def test_a_frozen_robot_is_a_network_error(client: Any, bench: Served) -> None:
    """It stops by itself for want of commands, and is there again when it thaws."""
    tracking(client)
    began = time.monotonic()
    bench.ask("freeze", frozen=True)
    with pytest.raises(franky.NetworkException):
        client.join_motion(5.0)
    assert time.monotonic() - began < HANGS
    bench.ask("freeze", frozen=False)
    with pytest.raises(franky.CommandException, match="Reflex"):
        connected(bench)
    bench.ask("recover")
    assert connected(bench).state.robot_mode == franky.RobotMode.Idle


def test_a_cut_connection_leaves_a_robot_to_connect_to_again(client: Any, bench: Served) -> None:
    tracking(client)
    bench.ask("hang_up")
    with pytest.raises(Exception, match=r"libfranka|Net"):
        client.join_motion(5.0)
    bench.ask("recover")
    connected(bench).move(franky.JointMotion(HOME))


def test_a_killed_robot_is_an_error_and_a_new_one_is_found_at_its_address() -> None:
    with served(**files("bottle_and_table")) as first:
        robot = connected(first)
        tracking(robot)
        first.ask("kill")
        with pytest.raises(Exception, match=r"libfranka|Net"):
            robot.join_motion(5.0)
        with served(**files("bottle_and_table"), address=first.address) as second:
            assert connected(second).state.robot_mode == franky.RobotMode.Idle


def test_a_free_running_robot_does_not_wait() -> None:
    """Commands that come late are lost, and counted. How many are late, the load of the machine decides."""
    with served(**files("bottle_and_table"), lockstep=False) as bench:
        robot = connected(bench)
        began, at = time.monotonic(), fresh(robot).time.to_sec()
        later = passed(robot, 0.3).time.to_sec() - at
        assert later < time.monotonic() - began + 0.1
        tracking(robot)
        while not (counts := bench.ask("counts"))["commanded"]:
            assert time.monotonic() < began + HANGS, "no command arrived"
        assert 0 <= counts["lost"] < counts["commanded"]


def test_another_version_of_the_protocol_is_reported() -> None:
    with (
        served(**files("bottle_and_table"), version=9) as bench,
        pytest.raises(franky.IncompatibleVersionException),
    ):
        connected(bench)


def test_closed_brakes_are_reported(client: Any, bench: Served) -> None:
    bench.ask("brakes", closed=True)
    _until(client, franky.RobotMode.Other)
    with pytest.raises(franky.CommandException, match="brakes"):
        client.move(franky.JointMotion(HOME))
    bench.ask("brakes", closed=False)
    _until(client, franky.RobotMode.Idle)


def test_an_arm_that_is_led_by_hand_says_so_and_goes_along(client: Any, bench: Served) -> None:
    goal = (np.array(HOME) + 0.2).tolist()
    bench.ask("guide", q=goal)
    _until(client, franky.RobotMode.Guiding)
    _until(client, franky.RobotMode.Idle)
    assert passed(client, RESTS).q == pytest.approx(goal, abs=2e-3)
