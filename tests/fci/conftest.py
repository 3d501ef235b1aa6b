"""A bottle on a table, and a Franka before them: one server for all tests."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from .served import Served, files, served

RESTS = 0.5
"""s of robot time after which an arm that nobody commands is still."""


@pytest.fixture(scope="session")
def bench() -> Iterator[Served]:
    """Bottle and table; time passes four times as fast where nobody is in command."""
    with served(**files("bottle_and_table"), pace=4.0) as running:
        yield running


@pytest.fixture
def robot(bench: Served) -> Any:
    """A client, newly connected."""
    return connected(bench)


def connected(bench: Served) -> Any:
    """A client with thresholds that no motion of these tests comes near."""
    import franky

    robot = franky.Robot(bench.address, realtime_config=franky.RealtimeConfig.Ignore)
    robot.set_collision_behavior(60.0, 60.0)
    robot.relative_dynamics_factor = 0.3
    return robot


def fresh(robot: Any) -> Any:
    """A state that is newer than the call. While nobody reads, the client's socket keeps the oldest 92
    states and drops newer ones, and the first read returns the newest of those."""
    robot.state  # noqa: B018 (empties the socket)
    return robot.state


def passed(robot: Any, seconds: float) -> Any:
    """The state after so much robot time, however busy the machine is that the robot is served on."""
    end = fresh(robot).time.to_sec() + seconds
    while robot.state.time.to_sec() < end:
        time.sleep(0.01)
    return robot.state


def mean_force(robot: Any, looks: int = 25) -> Any:
    """Mean external force (3,), N, over `looks` states, two time constants of the observer apart.

    One state of a resting arm has 0.07 N of noise, and the machine's load decides which one is read.
    """
    return np.mean([passed(robot, 0.02).O_F_ext_hat_K[:3] for _ in range(looks)], axis=0)
