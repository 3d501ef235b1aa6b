"""A robot that goes wrong at a chosen moment, around a simulated one that does not.

It speaks the robot protocol and is all that the run sees; what a fault does to the world itself it
does in the physics.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from bench.harm.witness import Witness
from palpate.robots.robot import RobotState

if TYPE_CHECKING:
    import mujoco

    from palpate.robots.simulated.robot import MujocoRobot
    from palpate.trace.samples import Samples

Lie = Callable[[RobotState, "FaultyRobot"], RobotState]
"""What is told instead of the state."""
Act = Callable[["mujoco.MjModel", "mujoco.MjData", float], None]
"""What happens to the world in a physics step, so many seconds after the moment."""
Spoil = Callable[["Samples"], "Samples"]
"""What is logged instead of the samples."""


class FaultyRobot:
    """Implements `palpate.robots.robot.Robot`, faithfully until `moment` (s of robot time).

    Attributes:
        lie, act, spoil: the fault, by what it changes.
        raises: what calls raise, by name.
        ignores: calls that do nothing.
        once: the fault lasts for one tick, or one call, only.
        seen: the state when the fault began.
        struck: whether it has begun.
        witness: sees every physics step.
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
        """Everything that is not meddled with: limits, hand, gravity, thresholds."""
        return getattr(self._robot, name)

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
        """Let the world go on when nobody asks for it any more, s."""
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

    def hold(self) -> None:
        if self._call("hold"):
            self._robot.hold()

    def close(self) -> None:
        self._call("close")
        self._robot.close()

    def move_joints(self, *args: Any, **more: Any) -> None:
        if self._call("move_joints"):
            self._robot.move_joints(*args, **more)

    def move_pose(self, *args: Any, **more: Any) -> None:
        if self._call("move_pose"):
            self._robot.move_pose(*args, **more)

    def move_axis(self, *args: Any, **more: Any) -> None:
        if self._call("move_axis"):
            self._robot.move_axis(*args, **more)

    def swing(self, *args: Any, **more: Any) -> None:
        if self._call("swing"):
            self._robot.swing(*args, **more)

    def open_gripper(self, *args: Any, **more: Any) -> None:
        if self._call("open_gripper"):
            self._robot.open_gripper(*args, **more)

    def close_gripper(self, *args: Any, **more: Any) -> None:
        if self._call("close_gripper"):
            self._robot.close_gripper(*args, **more)

    def _call(self, name: str) -> bool:
        """Whether a call goes through; raises what the fault has it raise."""
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
    """The state with other fields."""
    return lambda state, _: replace(state, **fields)


def broken(field: str, value: float, index: int | None = None) -> Lie:
    """A vector of the state with a number in it, everywhere or at one place."""

    def lie(state: RobotState, _: FaultyRobot) -> RobotState:
        vector = np.array(getattr(state, field), dtype=float)
        vector[slice(None) if index is None else index] = value
        return replace(state, **{field: vector})

    return lie


def frozen(*fields: str) -> Lie:
    """Fields of the state as they were when the fault began."""

    def lie(state: RobotState, robot: FaultyRobot) -> RobotState:
        seen = robot.seen or state
        return replace(state, **{field: getattr(seen, field) for field in fields})

    return lie


def wrenched(change: Callable[[Any, float], Any]) -> Lie:
    """Another external wrench, both as sensed and without the arm's inertia; `change` is told how
    long, s, the fault lasts."""

    def lie(state: RobotState, robot: FaultyRobot) -> RobotState:
        since = state.t - robot.moment
        return replace(
            state, wrench=change(state.wrench, since), contact=change(state.contact, since)
        )

    return lie
