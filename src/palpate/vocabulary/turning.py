"""Primitives that turn the hand where it is, with what it holds or empty, and bring it back.

Gravity shows along which line a load hangs; tilted, where on that line; turned about the vertical, what of
that was the sensors' own. What a load resists turning with shows as it is swung. Each is a difference: what
the arm itself feels in such a motion is far more, and the same motion with the empty hand, at the same pose,
tells it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from palpate.geometry.pose import Array, Pose
from palpate.robots.accuracy import rubbing
from palpate.robots.kinematics import reachable
from palpate.robots.safety import Expectation
from palpate.robots.sheet import Pace
from palpate.robots.trajectory.posed import turned
from palpate.robots.trajectory.swing import SWING_PEAK
from palpate.trace.recording import Activity
from palpate.vocabulary.admissible import motion
from palpate.vocabulary.admissible.collision_geometry import near_spans
from palpate.vocabulary.admissible.grasp import torsion
from palpate.vocabulary.admissible.profile import POSE_ERROR
from palpate.vocabulary.admissible.solids import solids
from palpate.vocabulary.admissible.support import above
from palpate.vocabulary.base import (
    Blackboard,
    LeafFailure,
    Primitive,
    Resource,
    Steps,
    Surroundings,
)
from palpate.vocabulary.state import SymbolicState
from palpate.vocabulary.touch import BRIEF, DWELL, feel, finish, settle
from palpate.vocabulary.violation import Violation

HOLD = 1.0
"""s that a tilt is held: as long as a weight is measured."""
STRAIGHT = {"x": np.array([1.0, 0.0, 0.0]), "y": np.array([0.0, 1.0, 0.0])}
"""Axes of the tool."""
SWINGS = ((2.0, 8), (4.0, 12))
"""Hz and periods at full amplitude: two frequencies, as what gives way between pads and object grows
with the square of the frequency; below half of what the springs at the TCP let through, and in some
seconds the white noise of a joint's torque falls to some mN m."""
PRETENDED = 0.5
"""part of the moment at which the arm stops itself that joints which rub may pretend."""
STEP = math.radians(12.0)
"""between the tilts that are judged: an arm's wrist is badly placed 19° to either side of straight."""
SLACK = 0.9
"""part of the turning speed that a swing uses."""
WAYS = (90.0, -90.0, 60.0, -60.0)
"""degrees of a turn about the vertical that a planner tries: a quarter turn brings a lever that the arm's first
and last joints bear across to those that feel it best; less of it tells less."""
BENT = math.radians(10.0)
"""by which a joint may turn farther than the hand, which hardly moves: else the arm bends otherwise."""


def swing_angle(pace: Pace, frequency: float) -> float:
    """rad: amplitude of a swing at `frequency`, Hz, within the pace's speed and acceleration."""
    rate = 2.0 * math.pi * frequency
    acceleration = (pace.swinging_acceleration or 0.0) / SWING_PEAK
    return min(SLACK * pace.turning_speed / rate, acceleration / rate**2)


class _Turning(Primitive):
    """Rotation of the hand about the TCP and back, with a recording beside it."""

    claims: ClassVar[frozenset[Resource]] = frozenset({"arm"})
    group: ClassVar = "motion"
    tilts: ClassVar[bool] = True
    activity: ClassVar[Activity]

    @classmethod
    def groundings(cls, around: Surroundings) -> Iterator[Primitive]:
        """Groundings at the poses where an object is worked on."""
        if around.subject in around.state.scene.objects:
            yield cls()

    def turns(self, state: SymbolicState) -> list[Array]:
        """(3,) rad each, in the tool's axes: the farthest that it turns the hand."""
        raise NotImplementedError

    def requires(self, state: SymbolicState) -> list[Violation]:
        if state.pose_world_tcp is None:
            return [motion.unknown_start()]
        if state.is_bent:
            return [
                Violation(
                    "unknown-start",
                    f"{type(self).__name__} turns the hand at a pose; MovePose first",
                )
            ]
        if state.contact or (state.holding and not state.lifted):
            return [
                Violation(
                    "collision",
                    f"{type(self).__name__} turns the hand in free air; lift what it holds, or leave "
                    f"what it touches: MovePose to '{above(state, state.at)}' first",
                )
            ]
        return []

    def violations(self, state: SymbolicState) -> list[Violation]:
        found = super().violations(state)
        if found or state.pose_world_tcp is None:
            return found
        for pose in self._ends(state):
            if not reachable(state.scene.arm, pose, state.scene.pose_world_base):
                return [
                    Violation("unreachable", f"the arm cannot turn the hand as far at '{state.at}'")
                ]
            there = _at(state, pose)
            found += motion.violations(state, there, may_tilt=True)
            found += self._too_near(state, pose)
        return found

    def _ends(self, state: SymbolicState) -> Iterator[Pose]:
        here = state.pose_world_tcp
        assert here is not None
        for turn in self.turns(state):
            yield Pose.of(here.position, turned(here.quaternion, turn[None])[0])

    def _too_near(self, state: SymbolicState, pose: Pose) -> Iterator[Violation]:
        """Turning is no guarded motion: nothing may be where things could be by their poses."""
        assert state.pose_world_tcp is not None
        if near_spans(state, state.pose_world_tcp, pose, POSE_ERROR):
            yield Violation(
                "collision",
                f"turned at '{state.at}' the hand, or what it holds, would come within "
                f"{1e3 * POSE_ERROR:.0f} mm of something; MovePose to '{above(state, state.at)}' first",
            )

    def during(self, state: SymbolicState) -> SymbolicState:
        return replace(state, activity=self.activity, contact=None)

    def effects(self, state: SymbolicState) -> SymbolicState:
        return replace(state, activity="still", contact=None)

    def expectation(self, state: SymbolicState) -> Expectation:
        held = state.holding is not None
        return Expectation(holding=held, grasped=held)

    def _start(self, blackboard: Blackboard) -> None:
        reflexes = blackboard.robot.limits.reflexes
        held = blackboard.state.holding
        blackboard.robot.set_reflex(reflexes.carrying if held else reflexes.free)

    def _unturned(self, blackboard: Blackboard, before: Array) -> Steps:
        """Require that the held object hangs as it did `before` (6,): it neither slid nor turned in
        the fingers. The effect of joint friction in the same turn with the empty hand is allowed
        for.

        Raises:
            LeafFailure: it does not.
        """
        load, tool = blackboard.load, blackboard.robot.state.pose_world_tcp
        wrench = yield from feel(blackboard)
        if not blackboard.state.holding:
            changed = abs(float((wrench - before)[3:] @ tool.rotation[:, 1]))
            blackboard.unrepeated = max(blackboard.unrepeated, changed)
        elif load.moment is not None:
            change = load.turned(wrench, tool, load.doubt, blackboard.unrepeated)
            if change:
                raise LeafFailure(f"'{blackboard.state.holding}' moved in the fingers: {change}")
        return "as before"


class Tilt(_Turning):
    """Tilt the hand in place, with what it holds or empty: by `degrees` one way, the other way, and
    back, held still for a second each. MovePose to `<object>_pose + z_offset` first.

    In a Parallel with MeasureForces, holding an object in free air and again with the empty hand at the
    same pose, it shows how high the object's centre of mass is."""

    timeout: ClassVar[float] = 60.0
    activity: ClassVar[Activity] = "tilting"

    about: Annotated[
        Literal["x", "y"],
        Field(
            description="axis of the tool to turn about; y is the direction in which the fingers close"
        ),
    ] = "y"
    degrees: Annotated[float, Field(ge=5.0, le=45.0, description="how far, each way")] = 35.0

    @classmethod
    def groundings(cls, around: Surroundings) -> Iterator[Primitive]:
        if around.subject in around.state.scene.objects:
            for about in ("y", "x"):
                yield cls(about=about)

    def turns(self, state: SymbolicState) -> list[Array]:
        angle = math.radians(self.degrees)
        return [angle * STRAIGHT[self.about], -angle * STRAIGHT[self.about]]

    def requires(self, state: SymbolicState) -> list[Violation]:
        return super().requires(state) or [*self._straightening(state)]

    def _straightening(self, state: SymbolicState) -> Iterator[Violation]:
        """Violation: the wrist would come so near to straight that joint friction is taken for a
        collision."""
        scene, here = state.scene, state.pose_world_tcp
        assert here is not None
        most = PRETENDED * scene.arm.limits.reflexes.free.torque
        for turn in self.turns(state):
            steps = math.ceil(float(np.linalg.norm(turn)) / STEP)
            shares = np.linspace(0.0, 1.0, steps + 1)[1:, None]
            for quaternion in turned(here.quaternion, shares * turn):
                tilted = Pose.of(here.position, quaternion)
                felt = rubbing(scene.arm, scene.pose_world_base.inverse() @ tilted)
                if felt > most:
                    yield Violation("unreachable", self._too_straight(state.at))
                    return

    def _too_straight(self, at: str | None) -> str:
        other = "x" if self.about == "y" else "y"
        return (
            f"tilted about {self.about} by {self.degrees:g}° at '{at}', the arm's wrist comes so near to "
            f'straight that what rubs in it is felt as a collision; Tilt(about="{other}"), or go elsewhere'
        )

    def run(self, blackboard: Blackboard) -> Steps:
        robot, state = blackboard.robot, blackboard.state
        self._start(blackboard)
        before = yield from feel(blackboard)
        here = state.pose_world_tcp
        assert here is not None
        speed = blackboard.scene.arm.pace.speed
        for pose in (*self._ends(state), here):
            robot.move_pose(pose, speed)
            yield from finish(blackboard)
            yield from settle(blackboard, DWELL if pose is here else DWELL + HOLD)
        yield from self._unturned(blackboard, before)
        return f"tilted by {self.degrees:g}° both ways"


class Turn(_Turning):
    """Turn the hand about the vertical and back.

    In a Parallel with MeasureForces, empty and then with an object, it makes `com` surer."""

    activity: ClassVar[Activity] = "turning"
    extra: ClassVar[bool] = True

    degrees: Annotated[
        float,
        Field(ge=-150.0, le=150.0, description="counterclockwise"),
    ] = 90.0

    @classmethod
    def groundings(cls, around: Surroundings) -> Iterator[Primitive]:
        if around.subject in around.state.scene.objects:
            for degrees in WAYS:
                yield cls(degrees=degrees)

    def turns(self, state: SymbolicState) -> list[Array]:
        assert state.pose_world_tcp is not None
        upward = state.pose_world_tcp.rotation[2]
        return [math.radians(self.degrees) * upward]

    def requires(self, state: SymbolicState) -> list[Violation]:
        return super().requires(state) or [*self._bending(state)]

    def _bending(self, state: SymbolicState) -> Iterator[Violation]:
        """Violation: a joint would have to go round to its other end."""
        now = state.q
        most = math.radians(abs(self.degrees)) + BENT
        for pose in self._ends(state):
            then = solids(state.scene).configuration(pose)
            if now is not None and then is not None and np.abs(then - now).max() > most:
                yield Violation(
                    "unreachable",
                    f"turned by {self.degrees:g}° at '{state.at}', a joint of the arm comes to its end; "
                    f"Turn(degrees={-self.degrees:g})",
                )

    def run(self, blackboard: Blackboard) -> Steps:
        # About the vertical no weight turns in the fingers, and joints that rub come back otherwise.
        robot, here = blackboard.robot, blackboard.state.pose_world_tcp
        assert here is not None
        self._start(blackboard)
        for pose in (*self._ends(blackboard.state), here):
            robot.move_pose(pose, blackboard.scene.arm.pace.speed)
            yield from finish(blackboard)
            yield from settle(blackboard, BRIEF)
        return f"turned by {self.degrees:g}° and back"


class Swing(_Turning):
    """Swing the hand in place: a few degrees to and fro about each
    axis of the hand in turn, slowly and fast. MovePose to `<object>_pose + z_offset` first.

    In a Parallel with MeasureForces, with an object and empty as for Tilt, it shows the object's inertia."""

    timeout: ClassVar[float] = 60.0
    activity: ClassVar[Activity] = "swinging"

    def turns(self, state: SymbolicState) -> list[Array]:
        pace = state.scene.arm.pace
        angle = max(swing_angle(pace, frequency) for frequency, _ in SWINGS)
        return [sign * angle * axis for axis in np.eye(3) for sign in (1.0, -1.0)]

    def requires(self, state: SymbolicState) -> list[Violation]:
        if found := super().requires(state):
            return found
        if state.scene.arm.pace.swinging_acceleration is None:
            return [Violation("unreachable", "this arm's description does not let it swing")]
        return [*self._too_fast(state), *self._twisting(state)]

    def _too_fast(self, state: SymbolicState) -> Iterator[Violation]:
        """Violation: a joint would exceed its speed."""
        scene, here = state.scene, state.pose_world_tcp
        assert here is not None
        shapes = solids(scene)
        q = shapes.configuration(here)
        if q is None:
            return
        jacobian = shapes.arm.jacobian(q)
        speed = scene.arm.pace.turning_speed
        tool = (scene.pose_world_base.inverse() @ here).rotation
        twists = np.vstack([np.zeros((3, 3)), speed * tool])
        rates = np.abs(np.linalg.pinv(jacobian) @ twists)
        if (rates > scene.arm.limits.dq_max[:, None]).any():
            yield Violation(
                "unreachable",
                f"swung at '{state.at}', the arm's joints would be too fast; go elsewhere",
            )

    def _twisting(self, state: SymbolicState) -> Iterator[Violation]:
        """Violation: the held object would turn in the grip, by its weight and its inertia, as far
        as they are known or believed."""
        if state.holding is None or state.pose_tcp_object is None:
            return
        scene, shapes = state.scene, solids(state.scene)
        body, mass = scene.body(state.holding), shapes.mass(state.holding)
        centre = state.pose_tcp_object.apply(shapes.centre_of_mass(state.holding))
        lever = float(np.hypot(centre[0], centre[2]))
        inertia = mass * (float(body.size @ body.size) / 12.0 + lever**2)
        moment = mass * scene.gravity * lever
        moment += inertia * (scene.arm.pace.swinging_acceleration or 0.0)
        most = torsion(scene)
        if moment > most:
            yield Violation(
                "twist",
                f"swung, '{state.holding}' would turn in the grip with {moment:.1f} N m, of at most "
                f"{most:.1f} N m; grasp it nearer to its middle",
            )

    def run(self, blackboard: Blackboard) -> Steps:
        robot, pace = blackboard.robot, blackboard.scene.arm.pace
        self._start(blackboard)
        before = yield from feel(blackboard)
        for axis in np.eye(3):
            for frequency, cycles in SWINGS:
                robot.swing(axis, swing_angle(pace, frequency), frequency, cycles)
                yield from finish(blackboard)
                yield from settle(blackboard, BRIEF)
        yield from settle(blackboard, DWELL)
        yield from self._unturned(blackboard, before)
        return "swung about three axes"


def _at(state: SymbolicState, pose: Pose) -> SymbolicState:
    """The state with the hand, and what it holds, at a pose in free air."""
    moved = state.moved
    if state.holding is not None and state.pose_tcp_object is not None:
        moved = {**moved, state.holding: pose @ state.pose_tcp_object}
    return replace(state, pose_world_tcp=pose, joints=None, moved=moved)
