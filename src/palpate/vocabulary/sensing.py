"""Primitives that log what the robot feels into a buffer, and only while they are ticked."""

from __future__ import annotations

from typing import ClassVar

from palpate.robots.safety import Expectation
from palpate.trace.recording import Recording
from palpate.trace.samples import FORCES, POSE
from palpate.vocabulary.base import Blackboard, Primitive, Steps
from palpate.vocabulary.state import SymbolicState

FORCE_WINDOW = 1.0
"""s: 1000 torque samples bring the white noise of a force below 10 mN."""
POSE_WINDOW = 0.3
"""s."""


def _log(blackboard: Blackboard, buffer: str, window: float) -> Steps:
    """Log for `window` s, or, beside a motion in a Parallel, until the motion ends."""
    start, context = blackboard.robot.state.t, blackboard.state.context()
    beside_motion = blackboard.motions > 0
    while blackboard.motions > 0 if beside_motion else blackboard.robot.state.t - start < window:
        yield
    end = blackboard.robot.state.t
    blackboard.recorder.recordings.append(Recording(buffer, start, end, context))
    return f"{end - start:.1f} s logged"


class _Sensing(Primitive):
    def expectation(self, state: SymbolicState) -> Expectation:
        held = state.holding is not None
        return Expectation(
            holding=held, grasped=held, contact=state.activity in ("contact", "sliding")
        )

    def effects(self, state: SymbolicState) -> SymbolicState:
        return state.wrote(self.writes) if self.writes else state


class MeasureForces(_Sensing):
    """Log the external wrench into `gripper_forces`: for a second, or, beside a motion in a Parallel,
    until the motion ends."""

    group: ClassVar = "sensing"
    writes: ClassVar[str | None] = FORCES

    def run(self, blackboard: Blackboard) -> Steps:
        return (yield from _log(blackboard, FORCES, FORCE_WINDOW))


class MeasureGripperPose(_Sensing):
    """Log the pose of the fingertips into `gripper_pose`."""

    group: ClassVar = "sensing"
    writes: ClassVar[str | None] = POSE

    def run(self, blackboard: Blackboard) -> Steps:
        return (yield from _log(blackboard, POSE, POSE_WINDOW))
