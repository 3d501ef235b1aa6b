"""What an arm refuses by itself: commands as its own network would bring them, without one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from .bench import Setup, Workbench
from .served import files, own_address
from .wire import (
    JOINT_COMMAND,
    MOVE,
    Command,
    ControllerMode,
    Error,
    MotionMode,
    Request,
    RobotMode,
)


@pytest.fixture(scope="module")
def bench() -> Iterator[Workbench]:
    made = Workbench(Setup(**files("bottle_and_table"), noise="none", address=own_address()))
    yield made
    made.server.close()


@pytest.fixture
def arm(bench: Workbench) -> Any:
    """The arm, at rest and free of errors."""
    bench.robot.recover()
    for _ in range(200):
        bench.robot.cycle(None)
    return bench.robot


def move(arm: Any, motion: MotionMode, controls: ControllerMode) -> None:
    payload = MOVE.pack(controls, motion - 1, *[0.0] * 6, False, *[0.0] * 7)
    arm.request(Request(Command.MOVE, 1, payload))
    assert arm.mode is RobotMode.MOVE


def command(arm: Any, **fields: Any) -> None:
    """One cycle of a client."""
    asked = np.zeros(1, JOINT_COMMAND)[0]
    asked["message_id"] = arm.message_id
    for name, value in fields.items():
        asked[name] = value
    arm.cycle(asked)


def errors(arm: Any) -> list[Error]:
    return [Error(int(i)) for i in np.flatnonzero(arm.state.fields["reflex_reason"])]


def torques(first: float) -> np.ndarray[Any, Any]:
    return np.array([first, 0, 0, 0, 0, 0, 0])


@pytest.mark.parametrize("torque", [1.5, -1.5, np.nan, np.inf])
def test_a_torque_that_jumps_or_is_none(arm: Any, torque: float) -> None:
    move(arm, MotionMode.NONE, ControllerMode.EXTERNAL)
    command(arm, tau_J_d=torques(0.9))
    assert arm.mode is RobotMode.MOVE
    command(arm, tau_J_d=torques(0.9 + torque))
    assert arm.mode is RobotMode.REFLEX
    assert errors(arm) == [Error.TORQUE_DISCONTINUITY]


def test_an_arm_that_is_driven_too_fast(arm: Any) -> None:
    arm.request(_thresholds(1e3))
    move(arm, MotionMode.NONE, ControllerMode.EXTERNAL)
    torque = 0.0
    for _ in range(2000):
        torque = min(torque + 0.9, 40.0)
        command(arm, tau_J_d=torques(torque))
        if arm.mode is not RobotMode.MOVE:
            break
    assert Error.JOINT_VELOCITY in errors(arm)


@pytest.mark.parametrize(
    ("step", "error"),
    [(5e-3, Error.JOINT_MOTION_VELOCITY_LIMITS), (2e-3, Error.JOINT_VELOCITY_DISCONTINUITY)],
)
def test_a_joint_motion_that_jumps_is_refused(arm: Any, step: float, error: Error) -> None:
    move(arm, MotionMode.JOINT_POSITION, ControllerMode.JOINT_IMPEDANCE)
    q = arm.state.fields["q_d"].astype(float)
    command(arm, q_c=q)
    command(arm, q_c=q + torques(step))
    assert errors(arm) == [error]


def test_a_joint_motion_that_begins_elsewhere(arm: Any) -> None:
    move(arm, MotionMode.JOINT_POSITION, ControllerMode.JOINT_IMPEDANCE)
    command(arm, q_c=arm.state.fields["q"] + torques(0.1))
    assert errors(arm) == [Error.JOINT_START_POSE_INVALID]


def test_a_client_that_falls_silent(arm: Any) -> None:
    move(arm, MotionMode.NONE, ControllerMode.EXTERNAL)
    command(arm, tau_J_d=torques(0.0))
    for _ in range(19):
        arm.cycle(None)
    assert arm.mode is RobotMode.MOVE
    arm.cycle(None)
    assert errors(arm) == [Error.COMMUNICATION]


def test_thresholds_that_are_none_are_rejected(arm: Any) -> None:
    arm.answers()
    arm.request(_thresholds(-1.0))
    ((_, answer),) = arm.answers()
    assert answer == bytes([2])


def _thresholds(value: float) -> Request:
    return Request(Command.SET_COLLISION_BEHAVIOR, 1, np.full(52, value).tobytes())
