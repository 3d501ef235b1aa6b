"""Primitives that move the arm to a commanded pose or configuration."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.common.pose import Array, Pose
from palpate.estimation.quantities.com import CentreOfMass
from palpate.estimation.quantities.estimators import estimate_all
from palpate.primitives.base import (
    ARM,
    Blackboard,
    LeafFailure,
    Primitive,
    Steps,
    Surroundings,
    Wait,
)
from palpate.primitives.guarding import (
    BRIEF,
    DWELL,
    MEDIAN_TIME,
    finish,
    follow_free,
    lower,
    median_wrench,
    settle,
    slide,
    span_reflex,
    wait_guarded_span,
)
from palpate.primitives.load import UNFELT
from palpate.primitives.rules.clearance import is_vertical
from palpate.primitives.rules.collision_geometry import (
    beyond_joint_limits,
    joints_between,
    out_of_reach,
    swings,
    unfelt,
)
from palpate.primitives.rules.profile import POSE_ERROR, spans, stretches
from palpate.primitives.rules.support import clear_of_support, met_early, slides
from palpate.primitives.state import (
    HOME_CONFIG,
    PRECONDITION,
    SymbolicState,
    Violation,
    pose_of_joints,
)
from palpate.robots.pace import configuration, doubt, mistaken_weight
from palpate.robots.safety import Expectation
from palpate.scene.load import untouchable_reason
from palpate.trace.recording import pose_name

# m, largest position error at the end of a motion. An impedance-controlled arm with a load of 1.5
# kg sags by several millimetres. Soft springs may sag by more, as far as the load explains.
POSITION_TOLERANCE = 0.010
ANGLE_TOLERANCE = np.radians(3.0)  # rad, largest angle error at the end of a motion
UNDER_WAY = 90.0  # s, timeout of one motion: half a metre at the least speed of a cautious arm
LEAST_SPEED = 0.01  # m/s, least speed in a plan: below it, some joints stick and slip


class MovePose(Primitive):
    """Move the gripper in a straight line to a Cartesian equilibrium pose and settle there. Reach
    an object from above: first `<object>_pose + z_offset`, then `<object>_pose`. While an object is
    held on its support, moving sideways at the same height slides it with light pressure; lift it
    first to carry it."""

    claims: ClassVar = ARM
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
                "m/s, at most; by default as fast as is safe. Forces measured at low speed are less noisy"
            ),
        ),
    ] = None

    def target(self, state: SymbolicState) -> Pose:
        """TCP pose in the world of the expression."""
        return state.resolve(self.pose)

    @classmethod
    def groundings(cls, around: Surroundings) -> Iterator[MovePose]:
        for pose in around.poses:
            yield cls(pose=pose)

    def transferred(self, old: str, new: str) -> MovePose:
        head = pose_name(self.pose)
        # Replace the subject in the name of the pose, and keep the offsets.
        endings = ("_pose", "_approach", "_balance")
        names = {f"{old}{ending}": f"{new}{ending}" for ending in endings}
        return self.model_copy(update={"pose": names.get(head, head) + self.pose[len(head) :]})

    def requires(self, state: SymbolicState) -> list[Violation]:
        try:
            target = self.target(state)
        except InputError as error:
            return [Violation("unknown-symbol", str(error))]
        found = out_of_reach(state, target, self.pose)
        name = state.scene.symbols.subject(self.pose)
        # A large turn of the tool's axis must go through the level configuration.
        front = f"{name}_front"
        if front in state.scene.symbols.configurations and swings(state.pose_world_tcp, target):
            problem = f"the hand is not level; MoveJoints '{name}_level', then '{front}' first"
            return [*found, Violation(PRECONDITION, problem)]
        if name is None or name not in state.scene.objects or state.holding is not None:
            return found
        # The object's surface may have been measured far from its stated height.
        reason = untouchable_reason(state.scene, name)
        return [*found, Violation(PRECONDITION, reason)] if reason else found

    def bind(self, blackboard: Blackboard) -> None:
        state, name = blackboard.state, blackboard.scene.symbols.estimated_name(self.pose)
        # Bound once, so that the hand puts an object down where it took it.
        if name is not None and name not in state.bound:
            along, why = _balance_point(blackboard, name)
            blackboard.state = replace(state, bound={**state.bound, name: along})
            blackboard.bound[name] = f"{name} is {1e3 * along:+.0f} mm along, {why}"

    def slides(self, state: SymbolicState) -> bool:
        """True if this would drag the held object along its support."""
        if state.holding is None or state.lifted:
            return False
        return slides(state, state.after(self))

    def during(self, state: SymbolicState) -> SymbolicState:
        activity = "sliding" if self.slides(state) else "moving"
        return replace(state, activity=activity, contact=None)

    def effects(self, state: SymbolicState) -> SymbolicState:
        target = self.target(state)
        early = _early(state, target)
        return state_at_rest(
            state, self.pose, target.translate((0.0, 0.0, early)) if early else target
        )

    def expectation(self, state: SymbolicState) -> Expectation:
        held = state.holding is not None
        return Expectation(holding=held, grasped=held, contact=held and not state.lifted)

    def contact_place(self, blackboard: Blackboard) -> str:
        """Distance to the goal, and the palm's height above an object that it may have met."""
        state, here = blackboard.state, blackboard.robot.state.pose_world_tcp
        target = self.target(state)
        place = f", {1e3 * here.distance_to(target):.0f} mm before '{self.pose}'"
        body = None if state.holding else state.object_at(target)
        if body is None:
            return place
        room = float(here.position[2]) + state.scene.arm.hand.palm - state.top_of(body)
        if not 0.0 < room < POSE_ERROR:
            return place
        return (
            f"{place}; the palm is {1e3 * room:.0f} mm above the believed top of '{body.name}': if it is taller, "
            "state its size or pose, or grasp it higher"
        )

    def run(self, blackboard: Blackboard) -> Steps:
        target = self.target(blackboard.state)
        # A held object on its support slides, all other motions go span by span.
        if blackboard.state.activity == "sliding":
            yield from slide(blackboard, target, self.speed or np.inf)
            blackboard.state = blackboard.state.after_drag()
            message = self._distance_clause(blackboard, target)
        else:
            message = yield from self._go(blackboard, target)
        if blackboard.state.holding and not self.effects(blackboard.state).lifted:
            yield from lower(blackboard, self.pose)
        name = blackboard.scene.symbols.estimated_name(self.pose)
        found = blackboard.bound.pop(name or "", None)
        return f"{message}; {found}" if found else message

    def _go(self, blackboard: Blackboard, target: Pose) -> Steps:
        """Move span by span; an object that is set down may meet its support early."""
        robot, state, scene = blackboard.robot, blackboard.state, blackboard.scene
        lifted = self.effects(state).lifted
        sets_down = state.holding is not None and not lifted
        dwell = DWELL
        # One commanded motion with a speed limit for each span.
        way = list(spans(state, robot.state.target_world_tcp, target))
        left = sum(span.start.distance_to(span.end) for span in way)
        fastest = min(scene.arm.pace.speed, self.speed or np.inf)
        blackboard.clear_pressed_force(target.position - robot.state.target_world_tcp.position)
        robot.move_pose(target, fastest, stretches(way, scene))
        for span in way:
            left -= span.start.distance_to(span.end)
            left = left if span is not way[-1] else 0.0
            blackboard.set_reflex(
                span_reflex(robot.limits.reflexes, span, state.holding, sets_down),
                configuration(scene.arm, scene.pose_world_base.inverse() @ span.end),
                alone=state.holding is None and not span.guarded,
            )
            # Only guarded spans are monitored for contact tick by tick.
            if not span.guarded:
                yield from follow_free(blackboard, span, left)
            elif (yield from wait_guarded_span(blackboard, span, left, sets_down, self.pose)):
                return self._set_down(blackboard, target)
            dwell = BRIEF if span.guarded else DWELL
        # The ticks of the weighing also count towards the time at rest.
        yield from settle(blackboard, dwell - MEDIAN_TIME if lifted else dwell)
        if lifted:
            yield from _weigh(blackboard)
        return self._distance_clause(blackboard, target)

    def _set_down(self, blackboard: Blackboard, target: Pose) -> str:
        early = blackboard.robot.state.pose_world_tcp.distance_to(target)
        if early > POSE_ERROR:
            raise LeafFailure(
                f"'{blackboard.state.holding}' touched a support {1e3 * early:.0f} mm before "
                f"'{self.pose}': another body is there"
            )
        return f"set down {1e3 * early:.1f} mm early"

    def _distance_clause(self, blackboard: Blackboard, target: Pose) -> str:
        """Return the distance of the arm from its target as text; `LeafFailure` if it is too far."""
        measured = blackboard.robot.state.pose_world_tcp
        distance, angle = measured.distance_to(target), measured.angle_to(target)
        if distance > POSITION_TOLERANCE and blackboard.state.holding:
            # Soft springs sag by the load over their stiffness.
            sag = blackboard.load.weight / blackboard.scene.arm.stiffness.translation
            distance = measured.distance_to(target.translate((0.0, 0.0, -sag)))
        # Any larger error has another cause: an obstacle, or the edge of the workspace.
        if distance > POSITION_TOLERANCE or angle > ANGLE_TOLERANCE:
            raise LeafFailure(
                f"stopped {1e3 * distance:.1f} mm and {np.degrees(angle):.1f}° from '{self.pose}', "
                f"more than {1e3 * POSITION_TOLERANCE:.0f} mm or {np.degrees(ANGLE_TOLERANCE):.0f}°: "
                "an obstacle is in the way, or the pose is at the edge of the arm's reach"
            )
        return f"within {1e3 * distance:.1f} mm"


class MoveJoints(Primitive):
    """Move all joints to a named configuration or to joint angles. Start and end every plan at
    `home_config`, from where every pose is reached safely; never call it with an object in the
    gripper that stands on a surface."""

    claims: ClassVar = ARM
    group: ClassVar = "motion"
    timeout: ClassVar[float] = UNDER_WAY

    joints: Annotated[
        str | list[float],
        Field(
            description=(
                "named configuration, e.g. `home_config`, or a list of joint angles in rad"
            )
        ),
    ]

    def target(self, state: SymbolicState) -> Array:
        """Return the joint angles (7,), rad; an `InputError` for an unknown name or a wrong number of angles."""
        if isinstance(self.joints, str):
            return state.scene.symbols.joints(self.joints)
        count = len(state.scene.arm.joints)
        if len(self.joints) != count:
            raise InputError(
                f"MoveJoints needs {count} angles, not {len(self.joints)}; or use 'home_config'"
            )
        return np.array(self.joints)

    @classmethod
    def groundings(cls, around: Surroundings) -> Iterator[MoveJoints]:
        yield cls(joints=HOME_CONFIG)
        # Configurations in front of a handle, from which the arm goes home.
        before = (around.subject,) if around.subject else tuple(around.state.scene.fixtures)
        for name in (f"{one}_{place}" for one in before for place in ("level", "front")):
            if name in around.state.scene.symbols.configurations:
                yield cls(joints=name)

    def requires(self, state: SymbolicState) -> list[Violation]:
        try:
            target = self.target(state)
        except InputError as error:
            rule = "unknown-symbol" if isinstance(self.joints, str) else "unreachable"
            return [Violation(rule, str(error))]
        return beyond_joint_limits(state, target) or unfelt(state, target)

    def during(self, state: SymbolicState) -> SymbolicState:
        return replace(state, activity="moving", contact=None)

    def effects(self, state: SymbolicState) -> SymbolicState:
        name = self.joints if isinstance(self.joints, str) else None
        joints = self.target(state)
        pose = pose_of_joints(state.scene, joints)
        return replace(state_at_rest(state, name, pose), joints=joints, activity="still")

    def run(self, blackboard: Blackboard) -> Steps:
        # Thresholds include what torque errors imitate along the whole joint motion.
        robot, reflexes = blackboard.robot, blackboard.robot.limits.reflexes
        goal = self.target(blackboard.state)
        alone = blackboard.state.holding is None
        thresholds = reflexes.free if alone else reflexes.carrying
        blackboard.set_reflex(thresholds, *joints_between(robot.state.q, goal), alone=alone)
        robot.move_joints(goal)
        yield from finish(blackboard)
        yield from settle(blackboard, BRIEF)
        return "reached"


def _early(state: SymbolicState, target: Pose) -> float:
    """Height, m, above `target` at which a motion straight down ends, since its object is set down."""
    start, name, held = state.pose_world_tcp, state.holding, state.pose_tcp_object
    if start is None or name is None or held is None or not state.lifted:
        return 0.0
    return met_early(state, name, target @ held) if is_vertical(start, target) else 0.0


def state_at_rest(state: SymbolicState, at: str | None, target: Pose) -> SymbolicState:
    """The state at rest with the TCP, and the held object, at a pose."""
    there = replace(
        state, at=at, pose_world_tcp=target, joints=None, contact=None, activity="still"
    )
    if state.holding is None or state.pose_tcp_object is None:
        return there
    # The held object moves with the hand; its clearance decides if it is lifted.
    pose_world_object = target @ state.pose_tcp_object
    lifted = clear_of_support(state, state.holding, pose_world_object)
    return replace(
        there,
        lifted=lifted,
        activity="still" if lifted else "contact",
        moved=state.place_object(state.holding, pose_world_object),
    )


def _weigh(blackboard: Blackboard) -> Wait:
    """Measure the load that hangs free; it must hang as grasped, and within the payload."""
    robot, scene, name = blackboard.robot, blackboard.scene, blackboard.state.holding
    wrench = yield from median_wrench(blackboard)
    here = robot.state
    tool = here.pose_world_tcp
    # Uncertainty of the moment about the closing direction, in this posture.
    closing = scene.pose_world_base.rotation.T @ tool.rotation[:, 1]
    unsure = doubt(scene.arm, here.q, here.tau, closing)
    if reason := blackboard.load.turned(wrench, tool, unsure):
        raise LeafFailure(f"'{name}' moved in the grasp: {reason}")
    error = mistaken_weight(scene.arm, here.q, scene.pose_world_base.rotation.T @ [0.0, 0.0, 1.0])
    blackboard.load = blackboard.load.set_hanging_load(wrench, tool, unsure, error)
    weight, payload = blackboard.load.weight, robot.limits.payload
    if weight > payload * robot.gravity + UNFELT:
        raise LeafFailure(
            f"'{name}' weighs {weight / robot.gravity:.1f} kg, more than the payload of {payload:g} kg"
        )


def _balance_point(blackboard: Blackboard, name: str) -> tuple[float, str]:
    """Place along the line of a balance pose, m, and its source as text."""
    # It is the place nearest to the measured centre of mass. If the measurement does not differ
    # significantly from the believed place, it is the believed one.
    scene, trace = blackboard.scene, blackboard.recorder.snapshot()
    subject, line = scene.symbols.subjects[name], scene.symbols.lines[name]
    # Estimate the centre of mass from all recordings so far.
    (found,) = estimate_all([Parameter(subject, CentreOfMass.id)], trace, scene.bodies)
    if found.verdict != "identified":
        return line.believed, f"as believed: {found.verdict} so far"
    body = scene.body(subject)
    # Upper bound of the standard deviation along the line.
    std = float(np.abs(body.pose_world.rotation.T @ line.along) @ found.stds)
    # Project the estimate onto the line, and compare with the believed place.
    along = line.nearest(body.pose_at_rest.apply(found.values))
    apart = along - line.believed
    if abs(apart) < std:
        measured = f"measured {1e3 * apart:+.0f} ± {1e3 * std:.0f} mm from there"
        return line.believed, f"as believed: {measured}"
    return along, f"as measured to ± {1e3 * std:.1f} mm"
