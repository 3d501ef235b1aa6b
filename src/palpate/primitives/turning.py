"""Primitives that turn the hand in place, loaded or empty, and back.

At rest, gravity shows the vertical line of a load's centre of mass. A tilt shows the height on that
line. A turn about the vertical separates the sensors' own error. A swing shows the inertia. Each result
is a difference from the same motion with the empty hand at the same pose. The arm's own effects are far
larger.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from palpate.common.pose import Array, Pose
from palpate.primitives.base import (
    ARM,
    Blackboard,
    LeafFailure,
    Primitive,
    Steps,
    Surroundings,
    Wait,
)
from palpate.primitives.guarding import BRIEF, DWELL, finish, median_wrench, settle
from palpate.primitives.rules import motion
from palpate.primitives.rules.collision_geometry import near_spans
from palpate.primitives.rules.grasp import torsion
from palpate.primitives.rules.profile import POSE_ERROR
from palpate.primitives.rules.solids import solids
from palpate.primitives.rules.support import above
from palpate.primitives.state import SymbolicState, Violation
from palpate.robots.pace import rubbing
from palpate.robots.sheet import MotionLimits
from palpate.robots.trajectory import SWING_PEAK, rotate_quaternion
from palpate.trace.recording import Activity

HOLD = 1.0  # s, rest at each tilt: as long as a weight measurement
AXES = {"x": np.array([1.0, 0.0, 0.0]), "y": np.array([0.0, 1.0, 0.0])}  # Axes of the tool
# Frequencies, Hz, and numbers of periods at full amplitude. Two frequencies are needed since the
# effect of the compliance between pads and object grows with the square of the frequency. Both are
# below half of the bandwidth of the springs at the TCP. In some seconds the white noise of a joint
# torque averages to some mN m.
SWINGS = ((2.0, 8), (4.0, 12))
PRETENDED = 0.5  # Largest fraction of the moment's reflex threshold that joint friction may imitate
# rad between the tilts that are checked: the wrist is ill-conditioned within 19° of straight.
STEP = math.radians(12.0)
SLACK = 0.9  # Fraction of the turning speed that a swing uses
# Degrees, turns about the vertical that a planner tries. A quarter turn moves a lever from the
# first and last joints to the joints that sense it best. A smaller turn gives less evidence.
TURNS = (90.0, -90.0, 60.0, -60.0)
# rad, largest turn of a joint beyond that of the hand. A larger turn means another branch of the
# inverse kinematics.
BENT = math.radians(10.0)


def swing_angle(pace: MotionLimits, frequency: float) -> float:
    """Amplitude, rad, of a swing at `frequency`, Hz: min(v / ω, a / ω²), with ω = 2 π f and the pace's limits."""
    rate = 2.0 * math.pi * frequency
    acceleration = (pace.swinging_acceleration or 0.0) / SWING_PEAK
    return min(SLACK * pace.turning_speed / rate, acceleration / rate**2)


class _Turning(Primitive):
    """Rotation of the hand about the TCP and back, during a recording."""

    claims: ClassVar = ARM
    group: ClassVar = "motion"
    tilts: ClassVar[bool] = True
    activity: ClassVar[Activity]
    tries: ClassVar[tuple[Mapping[str, Any], ...]] = ({},)  # arguments for a planner, in order

    @classmethod
    def groundings(cls, around: Surroundings) -> Iterator[Primitive]:
        if around.subject in around.state.scene.objects:
            for arguments in cls.tries:
                yield cls(**arguments)

    def turns(self, state: SymbolicState) -> list[Array]:
        """Rotation vectors (3,), rad, in the tool's axes, of the extreme rotations."""
        raise NotImplementedError

    def requires(self, state: SymbolicState) -> list[Violation]:
        name = type(self).__name__
        if state.pose_world_tcp is None:
            return [motion.unknown_start()]
        if state.is_bent:
            problem = f"{name} turns the hand at a pose; MovePose first"
            return [Violation("unknown-start", problem)]
        # The load must hang free, and the hand touch nothing.
        if state.contact or (state.holding and not state.lifted):
            problem = (
                f"{name} turns the hand in free air; lift the held object, or end the contact: "
                f"MovePose to '{above(state, state.at)}' first"
            )
            return [Violation("collision", problem)]
        return []

    def violations(self, state: SymbolicState) -> list[Violation]:
        found = super().violations(state)
        here, held = state.pose_world_tcp, state.pose_tcp_object
        if found or here is None:
            return found
        # Each extreme rotation must be reachable and free of collisions.
        for pose in self._ends(state):
            if not solids(state.scene).reaches(pose):
                problem = f"the arm cannot turn the hand so far at '{state.at}'"
                return [Violation("unreachable", problem)]
            there = replace(state, pose_world_tcp=pose, joints=None)
            if state.holding is not None and held is not None:
                there = replace(there, moved=state.place_object(state.holding, pose @ held))
            found += motion.violations(state, there, may_tilt=True)
            # A turn is not a guarded motion: it stays clear by the error of believed poses.
            if near_spans(state, here, pose, POSE_ERROR):
                problem = (
                    f"turned at '{state.at}', the hand or the held object would come within "
                    f"{1e3 * POSE_ERROR:.0f} mm of a body; MovePose to '{above(state, state.at)}' first"
                )
                found.append(Violation("collision", problem))
        return found

    def _ends(self, state: SymbolicState) -> Iterator[Pose]:
        here = state.tcp
        for turn in self.turns(state):
            yield Pose.of(here.position, rotate_quaternion(here.quaternion, turn[None])[0])

    def during(self, state: SymbolicState) -> SymbolicState:
        return replace(state, activity=self.activity, contact=None)

    def effects(self, state: SymbolicState) -> SymbolicState:
        return replace(state, activity="still", contact=None)

    def _start(self, blackboard: Blackboard) -> None:
        reflexes = blackboard.robot.limits.reflexes
        held = blackboard.state.holding
        blackboard.set_reflex(reflexes.carrying if held else reflexes.free)

    def _turn(self, blackboard: Blackboard, hold: float, dwell: float) -> Wait:
        """Turn to each extreme rotation and rest for `hold` s, then turn back and rest for `dwell` s."""
        here = blackboard.state.tcp
        for pose in (*self._ends(blackboard.state), here):
            blackboard.robot.move_pose(pose, blackboard.scene.arm.pace.speed)
            yield from finish(blackboard)
            yield from settle(blackboard, dwell if pose is here else hold)

    def _require_same_hang(self, blackboard: Blackboard, before: Array) -> Wait:
        """Require that the held object hangs as at the wrench `before` (6,).

        The same turn with the empty hand measures the change of the moment by joint friction alone.
        Raises LeafFailure: it slid or turned in the fingers.
        """
        load, tool = blackboard.load, blackboard.robot.state.pose_world_tcp
        # Empty hand: learn the effect of joint friction. With a load: compare the moments.
        wrench = yield from median_wrench(blackboard)
        if not blackboard.state.holding:
            changed = abs(float((wrench - before)[3:] @ tool.rotation[:, 1]))
            blackboard.unrepeated = max(blackboard.unrepeated, changed)
        elif load.moment is not None:
            change = load.turned(wrench, tool, load.doubt, blackboard.unrepeated)
            if change:
                raise LeafFailure(f"'{blackboard.state.holding}' moved in the fingers: {change}")


class Tilt(_Turning):
    """Tilt the hand in place, with what it holds or empty: by `degrees` one way, the other way, and
    back, held still for a second each. MovePose to `<object>_pose + z_offset` first.

    In a Parallel with MeasureForces, holding an object in free air and again with the empty hand at the
    same pose, it shows how high the object's centre of mass is."""

    timeout: ClassVar[float] = 60.0
    activity: ClassVar[Activity] = "tilting"
    tries: ClassVar = ({"about": "y"}, {"about": "x"})

    about: Annotated[
        Literal["x", "y"],
        Field(description="axis of the gripper to turn about; its fingers close along y"),
    ] = "y"
    degrees: Annotated[float, Field(ge=5.0, le=45.0, description="how far, each way")] = 35.0

    def turns(self, state: SymbolicState) -> list[Array]:
        angle = math.radians(self.degrees)
        return [angle * AXES[self.about], -angle * AXES[self.about]]

    def requires(self, state: SymbolicState) -> list[Violation]:
        return super().requires(state) or [*self._straightening(state), *self._twisting(state)]

    def _twisting(self, state: SymbolicState) -> Iterator[Violation]:
        """Violation for a tilt in which the weight would turn the held object in the pads."""
        scene, held, name = state.scene, state.pose_tcp_object, state.holding
        if held is None or name is None or self.about == "x":
            return
        # Moment of the weight about the line between the pads, at both tilts: m g times the lever.
        x, _, z = held.apply(solids(scene).centre_of_mass(name)).tolist()
        angle, weight = math.radians(self.degrees), solids(scene).mass(name) * scene.gravity
        moment = weight * (abs(x) * math.cos(angle) + abs(z) * math.sin(angle))
        most = torsion(scene, name)
        if moment > most:
            yield Violation(
                "twist",
                f"tilted about y by {self.degrees:g}°, '{name}' would turn in the pads with {moment:.2f} N m, of "
                f'at most {most:.2f} N m; Tilt(about="x"), tilt less, or grasp it nearer to its middle',
            )

    def _straightening(self, state: SymbolicState) -> Iterator[Violation]:
        """Violation for a tilt near a straight wrist, where joint friction would be taken for a collision."""
        scene, here = state.scene, state.tcp
        most = PRETENDED * scene.arm.limits.reflexes.free.torque
        for turn in self.turns(state):
            # Check the effect of joint friction at tilts at most `STEP` apart.
            steps = math.ceil(float(np.linalg.norm(turn)) / STEP)
            shares = np.linspace(0.0, 1.0, steps + 1)[1:, None]
            for quaternion in rotate_quaternion(here.quaternion, shares * turn):
                tilted = Pose.of(here.position, quaternion)
                if rubbing(scene.arm, scene.pose_world_base.inverse() @ tilted) > most:
                    other = "x" if self.about == "y" else "y"
                    yield Violation(
                        "unreachable",
                        f"tilted about {self.about} by {self.degrees:g}° at '{state.at}', the wrist is so "
                        "straight that its joint friction looks like a collision; "
                        f'Tilt(about="{other}"), or choose another pose',
                    )
                    return

    def run(self, blackboard: Blackboard) -> Steps:
        self._start(blackboard)
        before = yield from median_wrench(blackboard)
        yield from self._turn(blackboard, hold=DWELL + HOLD, dwell=DWELL)
        yield from self._require_same_hang(blackboard, before)
        return f"tilted by {self.degrees:g}° both ways"


class Turn(_Turning):
    """Turn the hand about the vertical and back.

    In a Parallel with MeasureForces, empty and then with an object, it improves `com`."""

    activity: ClassVar[Activity] = "turning"
    tries: ClassVar = tuple({"degrees": degrees} for degrees in TURNS)
    extra: ClassVar[bool] = True

    degrees: Annotated[
        float, Field(ge=-150.0, le=150.0, description="counterclockwise, seen from above")
    ] = 90.0

    def turns(self, state: SymbolicState) -> list[Array]:
        return [math.radians(self.degrees) * state.tcp.rotation[2]]

    def requires(self, state: SymbolicState) -> list[Violation]:
        return super().requires(state) or [*self._bending(state)]

    def _bending(self, state: SymbolicState) -> Iterator[Violation]:
        """Violation for a turn in which a joint would have to change to another branch."""
        # A joint that turns much farther than the hand has changed its branch.
        now = state.q
        most = math.radians(abs(self.degrees)) + BENT
        for pose in self._ends(state):
            then = solids(state.scene).configuration(pose)
            if now is not None and then is not None and np.abs(then - now).max() > most:
                yield Violation(
                    "unreachable",
                    f"turned by {self.degrees:g}° at '{state.at}', a joint of the arm reaches its limit; "
                    f"Turn(degrees={-self.degrees:g})",
                )

    def run(self, blackboard: Blackboard) -> Steps:
        # A turn about the vertical does not change the load's moment: no comparison at the end.
        self._start(blackboard)
        yield from self._turn(blackboard, hold=BRIEF, dwell=BRIEF)
        return f"turned by {self.degrees:g}° and back"


class Swing(_Turning):
    """Swing the hand in place: a few degrees to and fro about each
    axis of the hand in turn, slowly and fast. MovePose to `<object>_pose + z_offset` first.

    In a Parallel with MeasureForces, with an object and empty as for Tilt, it shows the object's inertia."""

    timeout: ClassVar[float] = 60.0
    activity: ClassVar[Activity] = "swinging"

    def turns(self, state: SymbolicState) -> list[Array]:
        pace = state.scene.arm.pace
        # The largest amplitude bounds the extreme rotations of all swings.
        angle = max(swing_angle(pace, frequency) for frequency, _ in SWINGS)
        return [sign * angle * axis for axis in np.eye(3) for sign in (1.0, -1.0)]

    def requires(self, state: SymbolicState) -> list[Violation]:
        if found := super().requires(state):
            return found
        if state.scene.arm.pace.swinging_acceleration is None:
            return [Violation("unreachable", "this arm's description does not allow a swing")]
        return [*self._too_fast(state), *self._twisting(state)]

    def _too_fast(self, state: SymbolicState) -> Iterator[Violation]:
        """Violation for a swing in which a joint would exceed its speed limit."""
        scene, here = state.scene, state.tcp
        shapes = solids(scene)
        q = shapes.configuration(here)
        if q is None:
            return
        # Joint speeds of the turning speed about each axis of the tool: J⁺ times the twist.
        tool = (scene.pose_world_base.inverse() @ here).rotation
        twists = np.vstack([np.zeros((3, 3)), scene.arm.pace.turning_speed * tool])
        rates = np.abs(np.linalg.pinv(shapes.arm.jacobian(q)) @ twists)
        if (rates > scene.arm.limits.dq_max[:, None]).any():
            yield Violation(
                "unreachable",
                f"swung at '{state.at}', the arm's joints would be too fast; choose another pose",
            )

    def _twisting(self, state: SymbolicState) -> Iterator[Violation]:
        """Violation for a swing in which the load would turn in the grip, with the moment m g l + I α."""
        if state.holding is None or state.pose_tcp_object is None:
            return
        scene, shapes = state.scene, solids(state.scene)
        body, mass = scene.body(state.holding), shapes.mass(state.holding)
        centre = state.pose_tcp_object.apply(shapes.centre_of_mass(state.holding))
        lever = float(np.hypot(centre[0], centre[2]))
        # I <= m ((a² + b² + c²) / 12 + l²): a box about its centre, and the parallel axis theorem.
        inertia = mass * (float(body.size @ body.size) / 12.0 + lever**2)
        moment = mass * scene.gravity * lever
        moment += inertia * (scene.arm.pace.swinging_acceleration or 0.0)
        most = torsion(scene, state.holding)
        if moment > most:
            yield Violation(
                "twist",
                f"swung, '{state.holding}' would turn in the grip with {moment:.1f} N m, of at most "
                f"{most:.1f} N m; grasp it nearer to its middle",
            )

    def run(self, blackboard: Blackboard) -> Steps:
        robot, pace = blackboard.robot, blackboard.scene.arm.pace
        self._start(blackboard)
        before = yield from median_wrench(blackboard)
        for axis in np.eye(3):
            # Swing about each axis of the tool, slowly and fast.
            for frequency, cycles in SWINGS:
                robot.swing(axis, swing_angle(pace, frequency), frequency, cycles)
                yield from finish(blackboard)
                yield from settle(blackboard, BRIEF)
        yield from settle(blackboard, DWELL)
        yield from self._require_same_hang(blackboard, before)
        return "swung about three axes"
