"""Primitives that move a drawer, a door or a window by its handle."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import replace
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from palpate.common.pose import Pose
from palpate.primitives.along import LEAST, SPARE, Way, way_of, way_to_limit
from palpate.primitives.base import (
    ARM,
    GRIPPER,
    Blackboard,
    LeafFailure,
    Primitive,
    Steps,
    Surroundings,
    Wait,
)
from palpate.primitives.contact import PROBE_SPEED
from palpate.primitives.gripper import finish_fingers, grip
from palpate.primitives.guarding import BRIEF, DWELL, WrenchFilter, median_wrench, settle
from palpate.primitives.load import FingerLoad
from palpate.primitives.rules import motion
from palpate.primitives.rules.grasp import does_not_fit
from palpate.primitives.state import SymbolicState, Violation
from palpate.robots.safety import Expectation
from palpate.trace.recording import Activity

AT_HANDLE = 0.005  # m, largest distance of the TCP from a handle's grasp pose at which it is there
# m/s, speeds of the handle in passes: dry friction is constant, viscous friction grows.
SPEEDS = (0.02, 0.05, 0.1)
# N along the way at which a fixture counts as stuck; a door closer resists with 20 to 30 N.
MOST = 40.0
PRESSED = 30.0  # N along the way at which a limit counts as met: friction is less
RUN_UP = 0.03  # m in the opposite direction before a fixture is moved against a limit
BACK = 0.0005  # m from its original place at which a fixture counts as back
CORRECTIONS = 4  # Largest number of corrections on the way back


class _Working(Primitive):
    """Base of motions with a handle between the fingers, which return it to its place."""

    claims: ClassVar = ARM | GRIPPER
    group: ClassVar = "motion"
    tilts: ClassVar[bool] = True
    timeout: ClassVar[float] = 240.0
    activity: ClassVar[Activity]

    @classmethod
    def groundings(cls, around: Surroundings) -> Iterator[Primitive]:
        if around.subject in around.state.scene.fixtures:
            yield cls()

    def ways(self, state: SymbolicState, name: str) -> list[Violation]:
        """Violations of the motion of a fixture that the hand is at, or above."""
        raise NotImplementedError

    def requires(self, state: SymbolicState) -> list[Violation]:
        if state.pose_world_tcp is None:
            return [motion.unknown_start()]
        name = fixture_at(state)
        if name is None:
            problem = "the gripper is not at a handle; MovePose to `<fixture>_pose` first"
        elif state.gripper != "open" or state.holding:
            problem = "the gripper must be open and empty; OpenGripper first"
        elif unfit := does_not_fit(state.scene, name):
            problem = f"{unfit}; remove measurements that move '{name}', and explain"
            return [Violation("too-wide", problem)]
        else:
            return self.ways(state, name)
        return [Violation("gripper-state", problem)]

    def during(self, state: SymbolicState) -> SymbolicState:
        name = fixture_at(state)
        if name is None or not at_handle(state, name):
            return replace(state, activity=self.activity)
        return replace(state, activity=self.activity, holding=name, grasp=state.at)

    def effects(self, state: SymbolicState) -> SymbolicState:
        # The hand releases the fixture at its original place.
        return replace(state, activity="still", contact=None)

    def expectation(self, state: SymbolicState) -> Expectation:
        return Expectation(contact=True)


class MoveHandle(_Working):
    """Grasp the handle at `<fixture>_pose`, move it along its joint and back at three speeds, release it. At
    `<fixture>_pose + z_offset` the empty hand moves alike."""

    activity: ClassVar[Activity] = "working"

    passes: Annotated[int, Field(ge=1, le=10, description="at each speed")] = 2

    def ways(self, state: SymbolicState, name: str) -> list[Violation]:
        way = way_of(state, name)
        return [] if isinstance(way, Way) else way

    def run(self, blackboard: Blackboard) -> Steps:
        state, name = before(blackboard)
        way = way_of(state, name)
        assert isinstance(way, Way)
        held = blackboard.state.holding == name
        # Grasp the handle; a limit that is only believed is approached slowly first.
        yield from _take_hold(blackboard, name, held)
        if held and way.is_unsure:
            way = yield from _short_of_limit(blackboard, way, name)
        # Passes at several speeds separate dry from viscous friction.
        for speed in SPEEDS:
            for share in (1.0, 0.0) * self.passes:
                yield from _pass(blackboard, way, share, speed, held)
        yield from _let_go(blackboard, way, held)
        done = f"{1e3 * way.length:.0f} mm and back, {len(SPEEDS) * self.passes} times"
        return f"moved '{name}' by {done}" if held else f"moved the empty hand by {done}"


class FindLimits(_Working):
    """Grasp the handle at `<fixture>_pose`, move it against the unknown limits of its joint and back,
    release it."""

    activity: ClassVar[Activity] = "limit"

    def ways(self, state: SymbolicState, name: str) -> list[Violation]:
        if not at_handle(state, name):
            problem = (
                f"the handle of '{name}' is not between the fingers; MovePose '{name}_pose' first"
            )
            return [Violation("gripper-state", problem)]
        found: list[Violation] = []
        for sign in _sides(state, name):
            way = way_to_limit(state, name, sign)
            found += [] if isinstance(way, Way) else way
        return found

    def run(self, blackboard: Blackboard) -> Steps:
        state, name = before(blackboard)
        sides = _sides(state, name)
        ways = [way for sign in sides if isinstance(way := way_to_limit(state, name, sign), Way)]
        yield from _take_hold(blackboard, name, held=True)
        met: list[str] = []
        for way in ways:
            # Push against each limit from a run-up, then return to the start.
            yield from _run_up(blackboard, way)
            if not (yield from _pass(blackboard, way, 1.0, PROBE_SPEED, True, to_limit=True)):
                raise LeafFailure(
                    f"'{name}' has no limit within {1e3 * way.length:.0f} mm, the farthest that the arm can move it"
                )
            # Convert the position of the TCP at the limit into the joint's coordinate.
            there = way.joint.travels(
                way.start, blackboard.robot.state.pose_world_tcp.position[None]
            )
            met.append(f"{way.joint.position + float(there[0]):.3f} {way.joint.unit()}")
            yield from _pass(blackboard, way, 0.0, SPEEDS[0], True, to_limit=True)
        yield from _let_go(blackboard, ways[0], held=True)
        return f"'{name}' stops at {' and '.join(met)}"


def return_fixture(blackboard: Blackboard) -> Wait:
    """Move the held fixture slowly along its joint to where it was grasped.

    Raises LeafFailure: it is stuck, or slipped out of the fingers.
    """
    state, name = before(blackboard)
    joint = state.scene.body(name).joint
    assert joint is not None
    here = blackboard.robot.state.pose_world_tcp.position
    way = Way(joint, state.tcp, float(joint.travels(state.tcp, here[None])[0]))
    yield from _pass(blackboard, way, 0.0, SPEEDS[0], True)
    yield from _bring_back(blackboard, way)


def _sides(state: SymbolicState, name: str) -> list[float]:
    """Return the signs of the open limits, or of both, the farther one first: 1 upper, -1 lower."""
    joint = state.scene.body(name).joint
    assert joint is not None
    # Open limits are those that the scene does not state.
    sides = [sign for sign, is_open in zip((-1.0, 1.0), joint.open, strict=True) if is_open]
    return sorted(sides or (-1.0, 1.0), key=joint.room, reverse=True)


def before(blackboard: Blackboard) -> tuple[SymbolicState, str]:
    """State before a running primitive grasped, and the name of the fixture at the hand."""
    state = replace(blackboard.state, holding=None, activity="still")
    name = fixture_at(state)
    assert name is not None
    return state, name


def fixture_at(state: SymbolicState) -> str | None:
    """Fixture whose grasp pose the hand is at or above, by name."""
    if state.at is None or state.is_bent:
        return None
    name = state.scene.symbols.subject(state.at)
    return name if name in state.scene.fixtures else None


def at_handle(state: SymbolicState, name: str) -> bool:
    """True if the handle of a fixture is between the fingers."""
    return state.tcp.distance_to(state.resolve(f"{name}_pose")) < AT_HANDLE


def _take_hold(blackboard: Blackboard, name: str, held: bool) -> Wait:
    """Measure the wrench of the empty hand, set the reflex, and if `held` close the fingers on the handle."""
    robot = blackboard.robot
    blackboard.load = FingerLoad((yield from median_wrench(blackboard)))
    blackboard.set_reflex(robot.limits.reflexes.contact)
    if not held:
        return
    yield from grip(blackboard, f"the handle of '{name}' is not where it is believed")
    yield from settle(blackboard, BRIEF)


def _run_up(blackboard: Blackboard, way: Way) -> Wait:
    """Move away from the limit first, so that the force of the motion shows before that of the limit."""
    # Share of the way in the opposite direction, limited by the room there.
    room = way.joint.room(-np.copysign(1.0, way.travel)) / abs(way.travel)
    back = min(RUN_UP / way.length, room)
    if back * way.length > BACK:
        yield from _pass(blackboard, way, -back, SPEEDS[0], True, to_limit=True)


def _short_of_limit(
    blackboard: Blackboard, way: Way, name: str
) -> Generator[float | None, None, Way]:
    """Move slowly along the way and back; if a limit is met, return the way that ends before it."""
    shorter = way
    if (yield from _pass(blackboard, way, 1.0, PROBE_SPEED, True, to_limit=True)):
        shorter = way.shorten_to(blackboard.robot.state.pose_world_tcp.position)
    yield from _pass(blackboard, way, 0.0, SPEEDS[0], True, to_limit=True)
    if shorter.length < LEAST or shorter.travel * way.travel < 0.0:
        yield from _let_go(blackboard, way, held=True)
        met = 1e3 * (shorter.length + SPARE)
        raise LeafFailure(
            f"'{name}' has a limit after {met:.0f} mm that the scene does not state; the measurement needs "
            f"{1e3 * (LEAST + SPARE):.0f} mm: open it, or state its range"
        )
    return shorter


def _let_go(blackboard: Blackboard, way: Way, held: bool) -> Wait:
    if held:
        yield from _bring_back(blackboard, way)
        blackboard.robot.open_gripper()
        yield from finish_fingers(blackboard)
    yield from settle(blackboard, DWELL)


def _pass(
    blackboard: Blackboard, way: Way, share: float, speed: float, held: bool, to_limit: bool = False
) -> Generator[float | None, None, bool]:
    """Move to a share of the way, and rest; True if a limit stopped it (`to_limit`)."""
    robot, joint = blackboard.robot, way.joint
    filtered, met = WrenchFilter(robot), False
    _start_motion(blackboard, way, share, speed)
    yield
    while robot.state.moving:
        # Force along the joint's direction against the empty hand.
        wrench, here = filtered.now(), robot.state.pose_world_tcp.position
        force = float((wrench - blackboard.load.empty)[:3] @ joint.direction(here))
        if to_limit and abs(force) > PRESSED:
            robot.hold()
            met = True
        elif abs(force) > MOST:
            raise LeafFailure(
                f"it does not move at {abs(force):.0f} N: it is stuck, locked, or at a limit that the scene "
                "does not state"
            )
        if held and not robot.state.gripping:
            raise LeafFailure("the handle slipped out of the fingers")
        yield
    yield from settle(blackboard, BRIEF)
    return met


def _start_motion(blackboard: Blackboard, way: Way, share: float, speed: float) -> None:
    """Start the motion to a share of the way: straight for a slide, an arc for a hinge."""
    robot, joint = blackboard.robot, way.joint
    target = way.at(share)
    # A hinge turns about its axis by the difference from the current angle.
    if joint.is_slide:
        robot.move_pose(target, speed)
        return
    now = joint.travels(way.start, robot.state.target_world_tcp.position[None])[0]
    robot.turn_about(joint.axis, joint.anchor, share * way.travel - float(now), speed)


def _bring_back(blackboard: Blackboard, way: Way) -> Wait:
    """Push until the fixture is at its place; the arm lags its target by friction over stiffness."""
    robot, start = blackboard.robot, way.start
    target = start
    for _ in range(CORRECTIONS):
        error = start.position - robot.state.pose_world_tcp.position
        along = way.joint.direction(start.position)
        if abs(float(error @ along)) < BACK:
            return
        # Shift the target by the remaining error along the joint's direction.
        target = Pose(target.position + (error @ along) * along, target.quaternion)
        robot.move_pose(target, SPEEDS[0])
        while True:
            yield
            if not robot.state.moving:
                break
        yield from settle(blackboard, BRIEF)
