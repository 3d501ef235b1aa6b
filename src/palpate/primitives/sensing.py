"""Primitives that record sensor data into a buffer, and that convert a buffer into an estimate."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np

from palpate.common.parameter import Parameter
from palpate.estimation.estimate import round_to_std
from palpate.estimation.quantities.estimators import estimate_all
from palpate.estimation.quantities.height import Height
from palpate.estimation.quantities.mass import Mass
from palpate.estimation.quantities.motion import Momentum, Velocity
from palpate.estimation.quantities.position import Position
from palpate.estimation.quantities.quantity import Quantity
from palpate.primitives.base import Blackboard, ConversionPrimitive, LeafFailure, Primitive, Steps
from palpate.primitives.rules.support import above
from palpate.primitives.state import PRECONDITION, SymbolicState, Violation
from palpate.trace.recording import Conversion, Recording
from palpate.trace.samples import FORCES, POSE

FORCE_WINDOW = 1.0  # s: the mean of 1000 torque samples has a white noise below 10 mN in force
POSE_WINDOW = 0.3  # s, window of a pose measurement


class _Sensing(Primitive):
    group: ClassVar = "sensing"
    timeout: ClassVar[float] = 300.0  # Longer than any motion in the same Parallel
    window: ClassVar[float]

    def effects(self, state: SymbolicState) -> SymbolicState:
        return state.add_recording(self.writes) if self.writes else state

    def run(self, blackboard: Blackboard) -> Steps:
        robot, context = blackboard.robot, blackboard.state.context()
        # Record until the motion in the same Parallel ends, or for a fixed window.
        start, beside_motion = robot.state.t, blackboard.motions > 0
        while blackboard.motions > 0 if beside_motion else robot.state.t - start < self.window:
            yield np.inf if beside_motion else start + self.window - robot.state.t
        recording = Recording(f"{self.writes}", start, robot.state.t, context)
        blackboard.recorder.recordings.append(recording)
        return f"{recording.end - start:.1f} s logged"


class MeasureForces(_Sensing):
    """Log the external wrench into `gripper_forces`: for a second, or, in a Parallel with a motion,
    until the motion ends."""

    writes: ClassVar[str | None] = FORCES
    window: ClassVar[float] = FORCE_WINDOW


class MeasureGripperPose(_Sensing):
    """Log the pose of the fingertips into `gripper_pose`."""

    writes: ClassVar[str | None] = POSE
    window: ClassVar[float] = POSE_WINDOW


class _Conversion(ConversionPrimitive):
    """Base of palpate's conversions: each reads one buffer, whose context names the subject."""

    def subject(self, state: SymbolicState) -> str | None:
        context = state.buffers.get(self.reads or "")
        if context is None or self.measures is None:
            return None
        # The context of the buffer names the subject of the first evidence that fits.
        evidence = [one for one in self.measures.evidence if one.buffer == self.reads]
        subjects = (one.about(context) for one in evidence)
        return next((subject for subject in subjects if subject is not None), None)

    def requires(self, state: SymbolicState) -> list[Violation]:
        if self.reads not in state.buffers:
            return [self.unwritten()]
        if self.subject(state) is not None or self.measures is None:
            return []
        problem = (
            f"`{self.reads}` has no evidence of a {self.measures.label} for {type(self).__name__}; "
            f"first {self.measures.how}"
        )
        if state.holding and not state.lifted and self.writer():
            lifted = above(state, state.grasp)
            problem += (
                f": '{state.holding}' is not lifted; first: MovePose '{lifted}', {self.writer()}"
            )
        return [Violation(PRECONDITION, problem)]

    def effects(self, state: SymbolicState) -> SymbolicState:
        subject, quantity = self.subject(state), self.measures
        if subject is None or quantity is None:
            return state
        return replace(state, converted=state.converted | {Parameter(subject, quantity.id)})

    def run(self, blackboard: Blackboard) -> Steps:
        subject, quantity = self.subject(blackboard.state), self.measures
        assert subject is not None
        assert quantity is not None
        yield
        recorder, parameter = blackboard.recorder, Parameter(subject, quantity.id)
        # Estimate from the trace so far, with the latest recording of the buffer.
        recording = next(r for r in reversed(recorder.recordings) if r.buffer == self.reads)
        conversion = Conversion(
            type(self).__name__, subject, quantity.id, recording, blackboard.robot.state.t
        )
        trace = recorder.snapshot()
        trace = replace(trace, conversions=(*trace.conversions, conversion))
        (found,) = estimate_all([parameter], trace, blackboard.scene.bodies, blackboard.choice)
        if found.verdict == "not identified":
            raise LeafFailure(f"{parameter} is not identified: {found.method}")
        recorder.conversions.append(conversion)
        values = tuple(found.values.tolist())
        # The rest of the run uses the value: bodies on a measured surface move with it.
        blackboard.state = blackboard.state.learn_parameter(parameter, values)
        if parameter == Parameter(blackboard.state.holding or "", Mass.id):
            mass, gravity = found.physical, blackboard.robot.gravity
            blackboard.load = blackboard.load.after_weighing(
                float(mass), float(mass.stds[0]), gravity
            )
        pairs = zip(values, found.stds.tolist(), strict=True)
        shown = ", ".join(" ± ".join(round_to_std(value, std)) for value, std in pairs)
        return f"{subject} {quantity.label} {shown} {quantity.unit}"


class Force2Mass(_Conversion):
    """Convert `gripper_forces` into the mass of the held object.

    Only for a log made while the
    object was held still, lifted and balanced; not when it hangs tilted off its centre."""

    reads: ClassVar[str | None] = FORCES
    measures: ClassVar[type[Quantity] | None] = Mass


class Force2Velocity(_Conversion):
    """Convert `gripper_forces` logged during a motion into the velocity of the gripper."""

    reads: ClassVar[str | None] = FORCES
    measures: ClassVar[type[Quantity] | None] = Velocity


class Force2Momentum(_Conversion):
    """Convert `gripper_forces` logged during a motion into the momentum of the held object."""

    reads: ClassVar[str | None] = FORCES
    measures: ClassVar[type[Quantity] | None] = Momentum


class Pose2Height(_Conversion):
    """Convert `gripper_pose` logged in contact with a surface into the height of that surface above
    the world's origin."""

    reads: ClassVar[str | None] = POSE
    measures: ClassVar[type[Quantity] | None] = Height


class Pose2Plan(_Conversion):
    """Convert `gripper_pose` logged while an object is held into that object's x-y position."""

    reads: ClassVar[str | None] = POSE
    measures: ClassVar[type[Quantity] | None] = Position
