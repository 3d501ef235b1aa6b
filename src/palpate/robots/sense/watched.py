"""A robot whose signals are tested for sense before anybody acts upon them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from palpate.geometry.pose import Array, Pose
from palpate.robots.description import Limits, RobotDescription
from palpate.robots.reflex import Reflex
from palpate.robots.robot import Robot, RobotState
from palpate.robots.sense.fault import Fault
from palpate.robots.sense.watch import Watch
from palpate.robots.trajectory.straight import Stretch
from palpate.trace.recording import Hand
from palpate.trace.samples import Samples


class Watched:
    """A robot as it is, but that its states say when its signals cannot be believed
    (`RobotState.fault`), and that a force which one state alone tells is not in them.

    Its samples are the robot's own.
    """

    def __init__(self, robot: Robot, arm: RobotDescription) -> None:
        self._robot = robot
        self._watch = Watch(robot.limits, arm)
        self._advanced = True
        self._seen: RobotState | None = None
        self._shown: RobotState | None = None

    @property
    def fault(self) -> Fault | None:
        """Fault of the signals; None while they are sound."""
        return self._watch.fault

    @property
    def limits(self) -> Limits:
        """See `Robot`."""
        return self._robot.limits

    @property
    def hand(self) -> Hand:
        """See `Robot`."""
        return self._robot.hand

    @property
    def gravity(self) -> float:
        """See `Robot`."""
        return self._robot.gravity

    @property
    def state(self) -> RobotState:
        """See `Robot`."""
        state = self._robot.state
        if self._shown is None or state is not self._seen:
            self._seen, self._shown = state, self._judged(state)
        return self._shown

    def advance(self, duration: float) -> None:
        """See `Robot`."""
        self._robot.advance(duration)
        self._watch.asked(duration)
        self._advanced, self._shown = True, None

    def drain(self) -> Samples:
        """See `Robot`."""
        samples, known = self._robot.drain(), self._watch.fault
        self._watch.take(samples)
        if self._watch.fault is not known:
            self._shown = None
        return samples

    def move_joints(self, q: Array, speed: float = 1.0) -> None:
        """See `Robot`."""
        self._robot.move_joints(q, speed)

    def move_pose(self, target: Pose, speed: float, slower: Sequence[Stretch] = ()) -> None:
        """See `Robot`."""
        self._robot.move_pose(target, speed, slower)

    def move_axis(self, direction: Array, speed: float, travel: float) -> None:
        """See `Robot`."""
        self._robot.move_axis(direction, speed, travel)

    def swing(self, about: Array, angle: float, frequency: float, cycles: int) -> None:
        """See `Robot`."""
        self._robot.swing(about, angle, frequency, cycles)

    def open_gripper(self) -> None:
        """See `Robot`."""
        self._robot.open_gripper()

    def close_gripper(self, force: float | None = None) -> None:
        """See `Robot`."""
        self._robot.close_gripper(force)

    def hold(self) -> None:
        """See `Robot`."""
        self._robot.hold()

    def set_reflex(self, thresholds: Reflex) -> None:
        """See `Robot`."""
        self._robot.set_reflex(thresholds)

    def close(self) -> None:
        """See `Robot`."""
        self._robot.close()

    def _judged(self, state: RobotState) -> RobotState:
        if self._advanced:
            self._advanced = False
            self._watch.look(state)
        shown = self._watch.believable(state)
        fault = self._watch.fault
        if fault is None:
            return shown
        return replace(shown, fault=shown.fault or str(fault))
