"""The straight line to a Cartesian pose."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import replace
from typing import Annotated, ClassVar

from pydantic import Field

from palpate.errors import InputError
from palpate.geometry.pose import Pose
from palpate.robots.accuracy import doubt
from palpate.robots.safety import Expectation
from palpate.scene.raised import beyond
from palpate.vocabulary.admissible.profile import (
    POSE_ERROR,
    Span,
    spans,
    speed,
    stretches,
)
from palpate.vocabulary.admissible.reach import out_of_reach
from palpate.vocabulary.admissible.support import slides
from palpate.vocabulary.base import (
    Blackboard,
    LeafFailure,
    Primitive,
    Resource,
    Steps,
    Surroundings,
)
from palpate.vocabulary.load import UNFELT
from palpate.vocabulary.motion.arriving import UNDER_WAY, arrived, at_rest
from palpate.vocabulary.motion.balancing import bind
from palpate.vocabulary.motion.guarding import feel_on, go_on, reflex_on
from palpate.vocabulary.motion.lowering import lower
from palpate.vocabulary.motion.sliding import CONTACT_SPEED, PRESSED, drag, lowered, reflex_sliding
from palpate.vocabulary.state import SymbolicState
from palpate.vocabulary.touch import (
    BRIEF,
    DWELL,
    WHILE_FELT,
    feel,
    finish,
    settle,
)
from palpate.vocabulary.violation import PRECONDITION, Violation

LEAST_SPEED = 0.01
"""m/s that a plan may ask for: more slowly some joints of an arm stick and slip."""


class MovePose(Primitive):
    """Move the gripper in a straight line to a Cartesian equilibrium pose and settle there. Reach
    an object from above: first `<object>_pose + z_offset`, then `<object>_pose`. While an object is
    held on its support, moving sideways at the same height slides it with light pressure; lift it
    first to carry it."""

    claims: ClassVar[frozenset[Resource]] = frozenset({"arm"})
    group: ClassVar = "motion"
    timeout: ClassVar[float] = UNDER_WAY

    pose: Annotated[
        str,
        Field(
            min_length=1,
            max_length=200,
            description=(
                "pose expression NAME (± [factor *] OFFSET)*, e.g. `jar_pose + z_offset`, `jar_pose - 2*x_offset`"
            ),
        ),
    ]
    speed: Annotated[
        float | None,
        Field(
            ge=LEAST_SPEED,
            le=1.0,
            description=(
                "m/s, at most; left out, as fast as is safe. Forces measured on a slow way are less noisy"
            ),
        ),
    ] = None

    def target(self, state: SymbolicState) -> Pose:
        """The TCP pose in the world that the expression stands for."""
        return state.resolve(self.pose)

    @classmethod
    def groundings(cls, around: Surroundings) -> Iterator[MovePose]:
        for pose in around.poses:
            yield cls(pose=pose)

    def transferred(self, old: str, new: str) -> MovePose:
        head, *rest = self.pose.split(" ", 1)
        endings = ("_pose", "_approach", "_balance")
        names = {f"{old}{ending}": f"{new}{ending}" for ending in endings}
        return self.model_copy(update={"pose": " ".join([names.get(head, head), *rest])})

    def requires(self, state: SymbolicState) -> list[Violation]:
        try:
            target = self.target(state)
        except InputError as error:
            return [Violation("unknown-symbol", str(error))]
        return [*out_of_reach(state, target, self.pose), *self._misplaced(state)]

    def _misplaced(self, state: SymbolicState) -> Iterator[Violation]:
        name = state.scene.symbols.subject(self.pose)
        if name is None or name not in state.scene.objects or state.holding is not None:
            return
        if reason := beyond(state.scene, name):
            yield Violation(PRECONDITION, reason)

    def bind(self, blackboard: Blackboard) -> None:
        name = blackboard.scene.symbols.found_out(self.pose)
        if name is not None:
            bind(blackboard, name)

    def slides(self, state: SymbolicState) -> bool:
        """True if this would drag the held object along its support."""
        if state.holding is None or state.lifted:
            return False
        return slides(state, self.effects(state))

    def during(self, state: SymbolicState) -> SymbolicState:
        activity = "sliding" if self.slides(state) else "moving"
        return replace(state, activity=activity, contact=None)

    def effects(self, state: SymbolicState) -> SymbolicState:
        return at_rest(state, self.pose, self.target(state))

    def expectation(self, state: SymbolicState) -> Expectation:
        held = state.holding is not None
        return Expectation(holding=held, grasped=held, contact=held and not state.lifted)

    def run(self, blackboard: Blackboard) -> Steps:
        target = self.target(blackboard.state)
        if blackboard.state.activity == "sliding":
            yield from self._slide(blackboard, target)
            message = arrived(blackboard, target, self.pose)
        else:
            message = yield from self._go(blackboard, target)
        if blackboard.state.holding and not self.effects(blackboard.state).lifted:
            yield from lower(blackboard, self.pose)
        name = blackboard.scene.symbols.found_out(self.pose)
        found = blackboard.bound.pop(name or "", None)
        return f"{message}; {found}" if found else message

    def _go(self, blackboard: Blackboard, target: Pose) -> Steps:
        """The way in spans; an object that is set down may meet its support early."""
        robot, state = blackboard.robot, blackboard.state
        lifted = self.effects(state).lifted
        sets_down = state.holding is not None and not lifted
        dwell = DWELL
        way = list(spans(state, robot.state.target_world_tcp, target))
        left = sum(span.start.distance_to(span.end) for span in way)
        fastest = self._at_most(blackboard.scene.arm.pace.speed)
        robot.move_pose(target, fastest, stretches(way, blackboard.scene))
        for span in way:
            left -= span.start.distance_to(span.end)
            left = left if span is not way[-1] else 0.0
            robot.set_reflex(reflex_on(robot.limits.reflexes, span, state.holding, sets_down))
            if not span.guarded:
                yield from go_on(blackboard, span, left)
            elif (yield from feel_on(blackboard, span, left, sets_down, self.pose)):
                return self._set_down(blackboard, target)
            dwell = BRIEF if span.guarded else DWELL
        yield from settle(blackboard, dwell - WHILE_FELT if lifted else dwell)
        if lifted:
            yield from self._weigh(blackboard)
        return arrived(blackboard, target, self.pose)

    def _weigh(self, blackboard: Blackboard) -> Generator[None]:
        """Feel what hangs free: it must hang as it was grasped, and be no more than the arm carries."""
        state = blackboard.state
        hanging = yield from feel(blackboard)
        here = blackboard.robot.state
        tool = here.pose_world_tcp
        closing = state.scene.pose_world_base.rotation.T @ tool.rotation[:, 1]
        unsure = doubt(state.scene.arm, here.q, here.tau, closing)
        if reason := blackboard.load.turned(hanging, tool, unsure):
            raise LeafFailure(f"'{state.holding}' does not stay as it was grasped, {reason}")
        blackboard.load = blackboard.load.hung(hanging, tool, unsure)
        self._light_enough(blackboard)

    def _at_most(self, speed: float) -> float:
        """m/s: `speed`, unless the plan asks for less."""
        return speed if self.speed is None else min(speed, self.speed)

    def _slide(self, blackboard: Blackboard, target: Pose) -> Steps:
        robot = blackboard.robot
        robot.set_reflex(reflex_sliding(blackboard))
        start = robot.state.target_world_tcp
        safe = max(CONTACT_SPEED, speed(Span(start, target, True), blackboard.scene))
        fastest = self._at_most(safe)
        for share, force, pace in PRESSED:
            down = lowered(blackboard, target.position - start.position, force)
            way = share * (target.position - start.position)
            here = Pose(start.position + way - [0.0, 0.0, down], target.quaternion)
            robot.move_pose(here, min(pace, fastest))
            felt = yield from drag(blackboard)
            if share > 0.0:
                blackboard.load = blackboard.load.dragged(felt)
            yield from settle(blackboard, BRIEF)
        robot.move_pose(target, min(CONTACT_SPEED, fastest))
        yield from finish(blackboard)
        yield from settle(blackboard)
        return "slid"

    def _light_enough(self, blackboard: Blackboard) -> None:
        robot, weight = blackboard.robot, blackboard.load.weight
        if weight > robot.limits.payload * robot.gravity + UNFELT:
            raise LeafFailure(
                f"'{blackboard.state.holding}' weighs {weight / robot.gravity:.1f} kg, more than the "
                f"payload of {robot.limits.payload:g} kg"
            )

    def _set_down(self, blackboard: Blackboard, target: Pose) -> str:
        early = blackboard.robot.state.pose_world_tcp.distance_to(target)
        if early > POSE_ERROR:
            raise LeafFailure(
                f"'{blackboard.state.holding}' met a support {1e3 * early:.0f} mm before "
                f"'{self.pose}': something else is there"
            )
        return f"set down {1e3 * early:.1f} mm early"
