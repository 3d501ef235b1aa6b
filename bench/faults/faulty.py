"""A faulty robot: a simulated one that fails from a chosen moment on.

It implements the robot protocol; a fault of the world acts in the physics.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.execution.witness import Witness
from palpate.robots.robot import RobotState

if TYPE_CHECKING:
    import mujoco

    from palpate.robots.simulated.robot import MujocoRobot
    from palpate.trace.samples import Samples

Lie = Callable[[RobotState, "FaultyRobot"], RobotState]
"""Replaces the state that is reported."""
Act = Callable[["mujoco.MjModel", "mujoco.MjData", float], None]
"""Acts on the world in a physics step, given the seconds since the moment."""
Spoil = Callable[["Samples"], "Samples"]
"""Replaces the samples that are logged."""

CALLS = frozenset(
    (
        "hold",
        "close",
        "move_joints",
        "move_pose",
        "move_axis",
        "swing",
        "open_gripper",
        "close_gripper",
    )
)
"""Calls without a result that a fault may make fail, or ignore."""


class FaultyRobot:
    """Implementation of `palpate.robots.robot.Robot` that is sound until `moment` (s of robot time).

    Attributes:
        lie, act, spoil: the fault, of the state, the world or the samples.
        raises: errors that calls raise, by name of the call.
        ignores: calls that do nothing.
        once: the fault lasts for one tick, or one call.
        seen: the state when the fault began.
        struck: the fault has begun.
        witness: records every physics step.
    """

    def __init__(self, robot: MujocoRobot, moment: float) -> None:
        self._robot, self.moment = robot, moment
        self.lie: Lie | None = None
        self.act: Act | None = None
        self.spoil: Spoil | None = None
        self.raises: dict[str, BaseException] = {}
        self.ignores: frozenset[str] = frozenset()
        self.once = False
        self.seen: RobotState | None = None
        self.last = 0.0
        self._spent: set[str] = set()
        self._model = robot.world.model
        self.witness = Witness.of(robot.world)
        robot.world.watch = self._step

    def __getattr__(self, name: str) -> Any:
        """Calls of the robot that may raise or do nothing; limits, hand, gravity, thresholds as they
        are."""
        member = getattr(self._robot, name)
        if name not in CALLS:
            return member

        def call(*args: Any, **more: Any) -> None:
            if self._call(name):
                member(*args, **more)

        return call

    @property
    def struck(self) -> bool:
        return self._robot.state.t >= self.moment

    @property
    def state(self) -> RobotState:
        true = self._robot.state
        self.last = true.t
        if not self.struck:
            return true
        self._call("state")
        if self.seen is None:
            self.seen = true
        if self.lie is None or (self.once and true.t > self.seen.t):
            return true
        return self.lie(true, self)

    def outlast(self, duration: float) -> None:
        """Simulate `duration` s more after the run."""
        self._robot.advance(duration)

    def advance(self, duration: float) -> None:
        self._call("advance")
        self._robot.advance(duration)
        if self.struck and self.seen is None:
            self.seen = self._robot.state

    def drain(self) -> Samples:
        self._call("drain")
        samples = self._robot.drain()
        if self.spoil is None or not self.struck:
            return samples
        return self.spoil(samples)

    def _call(self, name: str) -> bool:
        """True if a call is executed; raises the fault's error."""
        if not self.struck or (self.once and name in self._spent):
            return True
        if name in self.raises:
            self._spent.add(name)
            raise self.raises[name]
        if name in self.ignores:
            self._spent.add(name)
            return False
        return True

    def _step(self, data: mujoco.MjData) -> None:
        self.witness(data)
        if self.act is not None and data.time >= self.moment:
            self.act(self._model, data, data.time - self.moment)


def telling(**fields: Any) -> Lie:
    """Replace fields of the state."""
    return lambda state, _: replace(state, **fields)


def broken(field: str, value: float, index: int | None = None) -> Lie:
    """Set a vector of the state to a number, or one of its elements."""

    def lie(state: RobotState, _: FaultyRobot) -> RobotState:
        vector = np.array(getattr(state, field), dtype=float)
        vector[slice(None) if index is None else index] = value
        return replace(state, **{field: vector})

    return lie


def frozen(*fields: str) -> Lie:
    """Keep fields of the state as they were when the fault began."""

    def lie(state: RobotState, robot: FaultyRobot) -> RobotState:
        seen = robot.seen or state
        return replace(state, **{field: getattr(seen, field) for field in fields})

    return lie


def wrenched(change: Callable[[Any, float], Any]) -> Lie:
    """Change the external wrench, both as sensed and without the arm's inertia; `change` receives the
    seconds since the fault began."""

    def lie(state: RobotState, robot: FaultyRobot) -> RobotState:
        since = state.t - robot.moment
        return replace(
            state, wrench=change(state.wrench, since), contact=change(state.contact, since)
        )

    return lie
