"""Primitives that declare what a buffer stands for, and have it estimated."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from palpate.estimation.estimate import rounded
from palpate.parameter import Parameter
from palpate.quantities.estimators import estimate_all
from palpate.quantities.height import Height
from palpate.quantities.mass import Mass
from palpate.quantities.motion import Momentum, Velocity
from palpate.quantities.position import Position
from palpate.quantities.quantity import Quantity
from palpate.trace.recording import Context, Conversion
from palpate.trace.samples import FORCES, POSE
from palpate.vocabulary.admissible.support import above
from palpate.vocabulary.base import Blackboard, ConversionPrimitive, LeafFailure, Steps
from palpate.vocabulary.state import SymbolicState
from palpate.vocabulary.violation import PRECONDITION, Violation


class _Conversion(ConversionPrimitive):
    """Base of all conversions: each reads one buffer, whose context names the subject."""

    def about(self, context: Context) -> str | None:
        """The subject of a buffer written in `context`; None when that is no evidence of what this
        measures."""
        assert self.measures is not None
        for evidence in self.measures.evidence:
            subject = evidence.about(context)
            if evidence.buffer == self.reads and subject is not None:
                return subject
        return None

    def subject(self, state: SymbolicState) -> str | None:
        context = state.buffers.get(self.reads or "")
        return self.about(context) if context else None

    def requires(self, state: SymbolicState) -> list[Violation]:
        if self.reads not in state.buffers:
            return [self.unwritten()]
        if self.subject(state) is not None or self.measures is None:
            return []
        problem = (
            f"what `{self.reads}` holds is no evidence of a {self.measures.label}, so "
            f"{type(self).__name__} has nothing to convert; first {self.measures.how}"
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
        recording = next(
            r for r in reversed(blackboard.recorder.recordings) if r.buffer == self.reads
        )
        conversion = Conversion(
            type(self).__name__, subject, quantity.id, recording, blackboard.robot.state.t
        )
        trace = blackboard.recorder.snapshot()
        trace = replace(trace, conversions=(*trace.conversions, conversion))
        parameter = Parameter(subject, quantity.id)
        (found,) = estimate_all([parameter], trace, blackboard.scene.bodies)
        if found.verdict == "not identified":
            raise LeafFailure(f"{parameter} is not identified: {found.method}")
        blackboard.recorder.conversions.append(conversion)
        value = tuple(found.values.tolist())
        blackboard.state = blackboard.state.learned(parameter, value)
        pairs = zip(value, found.stds.tolist(), strict=True)
        shown = ", ".join(" ± ".join(rounded(value, std)) for value, std in pairs)
        return f"{subject} {quantity.label} {shown} {quantity.unit}"


class Force2Mass(_Conversion):
    """Convert `gripper_forces` into the mass of the held object.

    Only for a log made while the
    object was held still, lifted and balanced; not when it hangs tilted off its centre."""

    reads: ClassVar[str | None] = FORCES
    measures: ClassVar[type[Quantity] | None] = Mass


class Force2Velocity(_Conversion):
    """Convert `gripper_forces` logged beside a motion into the velocity of the gripper.

    Irrelevant for anything static."""

    reads: ClassVar[str | None] = FORCES
    measures: ClassVar[type[Quantity] | None] = Velocity


class Force2Momentum(_Conversion):
    """Convert `gripper_forces` logged beside a motion into the momentum of the held object.

    Irrelevant for anything static."""

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
