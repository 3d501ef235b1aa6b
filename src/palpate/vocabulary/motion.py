"""Primitives that move the arm to where it is told."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import replace
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from palpate.errors import InputError
from palpate.geometry.pose import Array, Pose
from palpate.robots.accuracy import doubt
from palpate.robots.reflex import Reflex, Reflexes
from palpate.robots.safety import Expectation
from palpate.vocabulary.admissible.grasp import most_sideways
from palpate.vocabulary.admissible.profile import (
    GUARDED_SPEED,
    POSE_ERROR,
    Span,
    leaves,
    spans,
    speed,
    stretches,
)
from palpate.vocabulary.admissible.reach import beyond_joint_limits, out_of_reach
from palpate.vocabulary.admissible.support import clear_of_support, slides, would_be_dragged
from palpate.vocabulary.base import (
    Blackboard,
    LeafFailure,
    Primitive,
    Resource,
    Steps,
    Surroundings,
)
from palpate.vocabulary.load import ROUGHEST, UNFELT, Load
from palpate.vocabulary.state import HOME_CONFIG, SymbolicState, pose_of_joints
from palpate.vocabulary.touch import (
    BRIEF,
    DWELL,
    MET,
    WHILE_FELT,
    Feeling,
    feel,
    finish,
    guarded,
    in_words,
    settle,
)
from palpate.vocabulary.violation import Violation

CONTACT_SPEED = 0.02
"""m/s, whenever something is or may be touched."""
DOWN = np.array([0.0, 0.0, -1.0])
SET_DOWN = 10.0
"""N that a held object presses on its support, its weight aside, before it counts as set down."""
LOWERINGS = 3
"""How often an object that its support does not bear yet is lowered further."""
WAVERS = 0.4
"""N by which what is felt at rest changes from one moment to the next."""
PRESSES = 1.0
"""N besides what is just felt: what is left of it once the arm rests must be felt, too."""
POSITION_TOLERANCE = 0.010
"""m: an impedance-controlled arm with 1.5 kg on it sags by several millimetres. Where it sags by more,
as soft springs do, what hangs on it explains that."""
ANGLE_TOLERANCE = np.radians(3.0)
FIRMLY = 0.8
"""part of what keeps an object from turning between the pads that a slide may take: they creep."""
LIGHTLY = 3.0
"""N that is pressed at least, lest a slide lifts what it drags."""
PRESSED = (
    (0.0, LIGHTLY, CONTACT_SPEED),
    (0.5, 15.0, CONTACT_SPEED),
    (1.0, LIGHTLY, 2.0 * CONTACT_SPEED),
)
"""Part of a slide, how hard it is pressed there, N, and how fast it goes there, m/s, at most: a
normal force that the torque sensors resolve, and that rises and falls again, so that neither what the
arm's own friction adds to the sliding force nor what pulls with the way, like a spring, passes for
friction; and two speeds, so that what grows with the speed does not, either."""
UNDER_WAY = 90.0
"""s that one motion may take: half a metre at the least speed of a cautious arm."""
LEAST_SPEED = 0.01
"""m/s that a plan may ask for: more slowly some joints of an arm stick and slip."""


def feel_on(
    blackboard: Blackboard, span: Span, left: float, sets_down: bool, goal: str
) -> Generator[None, None, bool]:
    """Follow a guarded span of a motion under way, which goes on for `left` m behind it: True when
    the held object's support bears it and more, which ends the motion.

    Raises:
        LeafFailure: it meets something else; the arm still presses on it.
    """
    robot, feeling = blackboard.robot, Feeling(blackboard.robot)
    yield
    while not _passed(blackboard, span, left):
        wrench = feeling.now()
        change = wrench - feeling.first
        if sets_down and -blackboard.load.borne(wrench) > SET_DOWN:
            robot.hold()
            return True
        met = change[:3] - _explained(blackboard, change, sets_down, span)
        if np.linalg.norm(met) > MET:
            before = 1e3 * (left + robot.state.pose_world_tcp.distance_to(span.end))
            raise LeafFailure(
                f"unexpected contact: the hand pushes with {in_words(met)} on something "
                f"{before:.0f} mm before the end of the way to '{goal}'"
            )
        yield
    return False


def _go_on(blackboard: Blackboard, span: Span, left: float) -> Steps:
    """Follow a span of a motion under way in which nothing is near."""
    yield
    while not _passed(blackboard, span, left):
        yield
    return "passed"


def _passed(blackboard: Blackboard, span: Span, left: float) -> bool:
    """Whether a motion has left a span behind, or has ended."""
    state = blackboard.robot.state
    length = span.start.distance_to(span.end)
    gone = state.target_world_tcp.distance_to(span.start)
    return not state.moving or (left > 0.0 and gone >= length)


def _reflex(of: Reflexes, span: Span, holding: str | None, sets_down: bool) -> Reflex:
    """At what the arm stops itself on the way. What it leaves, or sets down, may press."""
    if span.guarded and (sets_down or leaves(span.start, span.end)):
        return replace(of.probing, load=of.carrying.load)
    return of.carrying if holding else of.free


def _sliding(blackboard: Blackboard) -> Reflex:
    """At what the arm stops itself as it drags what it holds: at more than the roughest support
    holds back of what presses on it, it has met something else."""
    contact = blackboard.robot.limits.reflexes.contact
    pressed = max(force for _, force, _ in PRESSED) + _weight(blackboard)
    return replace(contact, sideways=ROUGHEST * pressed + MET)


def _lowered(blackboard: Blackboard, way: Array, force: float) -> float:
    """m by which the equilibrium is lowered on a slide along `way` (3,): it presses with `force`, N,
    or less where what it then takes to drag the object would turn it between the pads; at most half of
    its weight is taken off its support."""
    load, stiffness = blackboard.load, blackboard.scene.arm.stiffness.translation
    bearable = FIRMLY * most_sideways(blackboard.state, way) / load.rough
    spare = bearable - _weight(blackboard)
    return min(force, max(spare, -0.5 * load.weight)) / stiffness


def _drag(blackboard: Blackboard) -> Generator[None, None, Array]:
    """Wait until the arm's commanded motion has ended; (6,) the wrench felt right before."""
    feeling = Feeling(blackboard.robot)
    yield
    wrench = feeling.now()
    while blackboard.robot.state.moving:
        yield
        wrench = feeling.now()
    return wrench


def _weight(blackboard: Blackboard) -> float:
    """N, of what is held: as felt or known, else the most that the arm carries."""
    robot, state = blackboard.robot, blackboard.state
    if blackboard.load.weight > 0.0:
        return blackboard.load.weight
    assert state.holding is not None
    known = state.scene.body(state.holding).known.get("mass", (robot.limits.payload,))
    return known[0] * robot.gravity


def _sagged(blackboard: Blackboard, target: Pose) -> Pose:
    """Where soft springs let what hangs on the hand pull it."""
    sag = blackboard.load.weight / blackboard.scene.arm.stiffness.translation
    return target.translated((0.0, 0.0, -sag)) if blackboard.state.holding else target


def _explained(blackboard: Blackboard, change: Array, sets_down: bool, span: Span) -> Array:
    """(3,) N: the part of a change of force (6,) that belongs to the motion."""
    lift = float(change[2])
    if sets_down:
        return np.array([0.0, 0.0, min(lift, 0.0)])
    if not leaves(span.start, span.end):
        return np.zeros(3)
    if blackboard.state.holding is None:
        return change[:3]  # what was pressed on is relieved
    heaviest = blackboard.robot.limits.payload * blackboard.robot.gravity
    return np.array([0.0, 0.0, min(max(lift, 0.0), heaviest)])


def at_rest(state: SymbolicState, at: str | None, target: Pose) -> SymbolicState:
    """The state at rest with the TCP at a pose, and with it what is held."""
    arrived = replace(
        state, at=at, pose_world_tcp=target, joints=None, contact=None, activity="still"
    )
    if state.holding is None or state.pose_tcp_object is None:
        return arrived
    pose_world_object = target @ state.pose_tcp_object
    lifted = clear_of_support(state, state.holding, pose_world_object)
    return replace(
        arrived,
        lifted=lifted,
        activity="still" if lifted else "contact",
        moved={**state.moved, state.holding: pose_world_object},
    )


def _bears(load: Load, wrench: Array) -> bool:
    """Whether, at what is felt, a support bears the whole load; a light one is pressed on it, as its
    weight alone would not be felt."""
    if not load.borne(wrench) < 0.0:
        return False
    return load.hanging is None or load.relieved(wrench) > UNFELT + PRESSES


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
        return state.scene.symbols.resolve(self.pose)

    @classmethod
    def groundings(cls, around: Surroundings) -> Iterator[MovePose]:
        for pose in around.poses:
            yield cls(pose=pose)

    def transferred(self, old: str, new: str) -> MovePose:
        head, *rest = self.pose.split(" ", 1)
        names = {f"{old}{ending}": f"{new}{ending}" for ending in ("_pose", "_approach")}
        return self.model_copy(update={"pose": " ".join([names.get(head, head), *rest])})

    def requires(self, state: SymbolicState) -> list[Violation]:
        try:
            target = self.target(state)
        except InputError as error:
            return [Violation("unknown-symbol", str(error))]
        return out_of_reach(state, target, self.pose)

    def slides(self, state: SymbolicState) -> bool:
        """Whether this would drag the held object along its support."""
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
            message = self._arrived(blackboard, target)
        else:
            message = yield from self._go(blackboard, target)
        if blackboard.state.holding and not self.effects(blackboard.state).lifted:
            yield from self._lower(blackboard)
        return message

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
            robot.set_reflex(_reflex(robot.limits.reflexes, span, state.holding, sets_down))
            if not span.guarded:
                yield from _go_on(blackboard, span, left)
            elif (yield from feel_on(blackboard, span, left, sets_down, self.pose)):
                return self._set_down(blackboard, target)
            dwell = BRIEF if span.guarded else DWELL
        yield from settle(blackboard, dwell - WHILE_FELT if lifted else dwell)
        if lifted:
            hanging = yield from feel(blackboard)
            tool = robot.state.pose_world_tcp
            closing = state.scene.pose_world_base.rotation.T @ tool.rotation[:, 1]
            unsure = doubt(state.scene.arm, robot.state.q, robot.state.tau, closing)
            if reason := blackboard.load.turned(hanging, tool, unsure):
                raise LeafFailure(f"'{state.holding}' does not stay as it was grasped, {reason}")
            blackboard.load = blackboard.load.hung(hanging, tool, unsure)
            self._light_enough(blackboard)
        return self._arrived(blackboard, target)

    def _at_most(self, speed: float) -> float:
        """m/s: `speed`, unless the plan asks for less."""
        return speed if self.speed is None else min(speed, self.speed)

    def _slide(self, blackboard: Blackboard, target: Pose) -> Steps:
        robot = blackboard.robot
        robot.set_reflex(_sliding(blackboard))
        start = robot.state.target_world_tcp
        safe = max(CONTACT_SPEED, speed(Span(start, target, True), blackboard.scene))
        fastest = self._at_most(safe)
        for share, force, pace in PRESSED:
            down = _lowered(blackboard, target.position - start.position, force)
            way = share * (target.position - start.position)
            here = Pose(start.position + way - [0.0, 0.0, down], target.quaternion)
            robot.move_pose(here, min(pace, fastest))
            felt = yield from _drag(blackboard)
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

    def _lower(self, blackboard: Blackboard) -> Steps:
        """On until the support bears what is held: the arm sags, and fingers that press slip. What
        a touch gave it to bear goes again as the arm comes to rest."""
        for _ in range(LOWERINGS):
            yield from settle(blackboard)
            if blackboard.load.too_much((yield from feel(blackboard)), WAVERS) is None:
                return "borne"
            yield from self._press(blackboard)
        return "lowered"

    def _press(self, blackboard: Blackboard) -> Steps:
        load, robot = blackboard.load, blackboard.robot
        feeling = Feeling(robot)
        robot.move_axis(DOWN, GUARDED_SPEED, POSE_ERROR)
        if not (yield from guarded(blackboard, lambda: _bears(load, feeling.now()))):
            raise LeafFailure(
                f"nothing bears '{blackboard.state.holding}' at '{self.pose}' or "
                f"{1e3 * POSE_ERROR:.0f} mm below: it stays in the fingers"
            )
        return "pressed"

    def _set_down(self, blackboard: Blackboard, target: Pose) -> str:
        early = blackboard.robot.state.pose_world_tcp.distance_to(target)
        if early > POSE_ERROR:
            raise LeafFailure(
                f"'{blackboard.state.holding}' met a support {1e3 * early:.0f} mm before "
                f"'{self.pose}': something else is there"
            )
        return f"set down {1e3 * early:.1f} mm early"

    def _arrived(self, blackboard: Blackboard, target: Pose) -> str:
        measured = blackboard.robot.state.pose_world_tcp
        distance, angle = measured.distance_to(target), measured.angle_to(target)
        if distance > POSITION_TOLERANCE:
            distance = measured.distance_to(_sagged(blackboard, target))
        if distance > POSITION_TOLERANCE or angle > ANGLE_TOLERANCE:
            raise LeafFailure(
                f"stopped {1e3 * distance:.1f} mm and {np.degrees(angle):.1f}° from '{self.pose}', "
                f"more than {1e3 * POSITION_TOLERANCE:.0f} mm or {np.degrees(ANGLE_TOLERANCE):.0f}°: "
                "something is in the way, or the pose is at the edge of the arm's reach"
            )
        return f"within {1e3 * distance:.1f} mm"


class MoveJoints(Primitive):
    """Move all joints to a named configuration or to seven angles. Start and end every plan at
    `home_config`, from where every pose is reached safely; never call it with an object in the
    gripper that stands on a surface."""

    claims: ClassVar[frozenset[Resource]] = frozenset({"arm"})
    group: ClassVar = "motion"
    timeout: ClassVar[float] = UNDER_WAY

    joints: Annotated[
        str | list[float],
        Field(
            description=(
                "named configuration, e.g. `home_config`, or a list of 7 joint angles in rad"
            )
        ),
    ]

    def target(self, state: SymbolicState) -> Array:
        """Joint angles (7,), rad.

        Raises:
            InputError: unknown name, or not seven numbers.
        """
        if isinstance(self.joints, str):
            return state.scene.symbols.joints(self.joints)
        if len(self.joints) != 7:
            raise InputError(
                f"MoveJoints needs 7 angles, not {len(self.joints)}; or use 'home_config'"
            )
        return np.array(self.joints)

    @classmethod
    def groundings(cls, around: Surroundings) -> Iterator[MoveJoints]:
        yield cls(joints=HOME_CONFIG)

    def requires(self, state: SymbolicState) -> list[Violation]:
        try:
            target = self.target(state)
        except InputError as error:
            rule = "unknown-symbol" if isinstance(self.joints, str) else "unreachable"
            return [Violation(rule, str(error))]
        return beyond_joint_limits(state, target) or would_be_dragged(state)

    def during(self, state: SymbolicState) -> SymbolicState:
        return replace(state, activity="moving", contact=None)

    def effects(self, state: SymbolicState) -> SymbolicState:
        name = self.joints if isinstance(self.joints, str) else None
        joints = self.target(state)
        pose = pose_of_joints(state.scene, joints)
        return replace(at_rest(state, name, pose), joints=joints, activity="still")

    def expectation(self, state: SymbolicState) -> Expectation:
        return Expectation(holding=state.holding is not None, grasped=state.holding is not None)

    def run(self, blackboard: Blackboard) -> Steps:
        reflexes = blackboard.robot.limits.reflexes
        blackboard.robot.set_reflex(
            reflexes.carrying if blackboard.state.holding else reflexes.free
        )
        blackboard.robot.move_joints(self.target(blackboard.state))
        yield from finish(blackboard)
        yield from settle(blackboard, BRIEF)
        return "reached"
