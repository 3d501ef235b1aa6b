"""The protocol of every robot, and commands as trajectories of the equilibrium."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol, runtime_checkable

import numpy as np

from palpate.common.pose import Array, Pose
from palpate.robots.description import Limits, RobotDescription
from palpate.robots.nominal import NominalArm, wrench
from palpate.robots.pace import free_speeds, joint_rates
from palpate.robots.sheet import Reflex
from palpate.robots.trajectory import (
    MotionState,
    PosePath,
    PositionPath,
    Stretch,
    lower_profile,
    quintic,
    rotate_quaternion,
    stop,
    straight,
    stretches,
    swing,
    wrist_turn,
)
from palpate.trace.recording import NominalHand
from palpate.trace.samples import Samples


@dataclass(frozen=True, slots=True, eq=False)
class RobotState:
    """The latest cached state."""

    t: float  # robot time now, s
    stamp: float  # robot time of the newest sensor sample, s
    q: Array  # (7,) rad
    dq: Array  # (7,) rad/s
    tau: Array  # (7,) N m, measured behind the gears
    tau_ext: Array  # N m, external part of `tau`
    pose_world_tcp: Pose  # measured
    target_world_tcp: Pose  # commanded equilibrium
    twist: Array  # (6,) TCP velocity, world axes
    wrench: Array  # (6,) external wrench, the convention of `palpate.trace`
    # (6,) the same without the arm's inertia: the wrench of a contact or a load, without the arm's
    # acceleration. All thresholds apply to it.
    contact: Array
    width: float  # m between the fingers
    gripping: bool  # the fingers stopped on an object before closing fully
    moving: bool  # the arm's commanded motion has not ended
    gripper_moving: bool  # the fingers have not stopped
    reflex: str | None = None  # reason of a reflex since the last motion was started
    # Reason that the sensors cannot be trusted (`palpate.robots.signals`), or that the arm accepts no
    # motion any more.
    fault: str | None = None
    mode: str = ""  # mode of a real arm's controller
    # N m, norm of the joint torques of a contact or a load that no force at the TCP explains; and that
    # force, N (`palpate.robots.nominal.explain_torque`).
    unexplained: tuple[float, float] = (0.0, 0.0)


class Robot(Protocol):
    """A 7-axis arm with a parallel hand and joint torque sensing.

    Lifecycle: it is constructed connected, at rest and logging. Then motions and `advance` alternate, once
    a tick; `close` ends it. Between two calls of `advance` no property changes. A motion may start during
    another one, and continues from its position and velocity without a jerk. Only `advance` takes robot
    time.
    """

    @property
    def limits(self) -> Limits:
        """Safety limits from the description; they never change."""
        ...

    @property
    def hand(self) -> NominalHand:
        """Data of the nominal arm for the estimators; part of every trace."""
        ...

    @property
    def gravity(self) -> float:
        """Magnitude of gravity at the arm's place, m/s^2, along world -z."""
        ...

    @property
    def state(self) -> RobotState:
        """State as of the last `advance`; reading it never blocks.

        After a lost connection its `stamp` grows old.
        """
        ...

    def move_joints(self, q: Array, speed: float = 1.0) -> None:
        """Start a motion with bounded jerk to joint positions `q` (7,), rad.

        `speed` in (0, 1] scales the description's pace. `state.moving` until its end.
        """
        ...

    def move_pose(self, target: Pose, speed: float, slower: Sequence[Stretch] = ()) -> None:
        """Start a straight motion with bounded jerk of the commanded TCP pose to `target` (world).

        The speed is at most `speed` m/s, and no larger than the effective mass allows (`robots.pace`).
        `slower` lists lower limits, m/s, of consecutive parts of the motion.

        The arm follows like a spring: it presses on an obstacle, and may end at a distance from the
        target. `state.moving` until the command has ended.
        """
        ...

    def move_axis(self, direction: Array, speed: float, travel: float) -> None:
        """Move the TCP straight as `move_pose`, along the unit `direction` (3,) (world) at `speed` m/s for
        `travel` m, with constant orientation.
        """
        ...

    def swing(self, about: Array, angle: float, frequency: float, cycles: int) -> None:
        """Start swinging the commanded pose about the TCP.

        The motion is a sine of `angle` rad and `frequency` Hz about the unit axis `about` (3,) of the
        tool, for `cycles` periods. It grows in one period before and fades in one period after. It begins
        at rest and ends at its start. `state.moving` until then.
        """
        ...

    def turn_about(self, axis: Array, point: Array, angle: float, speed: float) -> None:
        """Start a motion with bounded jerk of the commanded pose on an arc.

        The pose turns by `angle` rad about the unit `axis` (3,) through a `point` (3,), m (world), at most
        at `speed` m/s. It begins at rest. `state.moving` until the command has ended.
        """
        ...

    def open_gripper(self, width: float | None = None) -> None:
        """Start opening the fingers to `width` m, or fully. `state.gripper_moving` until they have stopped."""
        ...

    def close_gripper(self, force: float | None = None) -> None:
        """Start closing the fingers with at most `force` N of both together, by default the description's
        grasp force.

        They close until they meet resistance (then `state.gripping`) or each other. `state.gripper_moving`
        until they have stopped. On a held object it changes the force.
        """
        ...

    def hold(self) -> None:
        """Stop the arm smoothly and hold it there. A contact keeps its force, and the fingers keep their
        grasp. Without effect at rest.
        """
        ...

    def set_reflex(self, thresholds: Reflex) -> None:
        """Set the `thresholds` at which the arm stops itself within 1 ms.

        `limits.reflexes` has those for free air, carrying, probing and contact. Until the first call,
        those for contact apply, which are the widest.

        After a reflex the arm yields: its equilibrium follows its measured pose, so that it presses on no
        obstacle, `state.moving` ends, and `state.reflex` has the reason. The fingers keep their grasp. The
        next motion clears it.

        On a Franka this is `setCollisionBehavior`, and `automaticErrorRecovery` before the next motion; a
        KUKA has force conditions that break a motion.
        """
        ...

    def advance(self, duration: float) -> None:
        """Let `duration` s of robot time pass, and update the state: simulated robots step, real robots wait.

        Raises ExecutionAborted: the robot cannot continue, and accepts no further commands.
        """
        ...

    def drain(self) -> Samples:
        """Return the samples since the last call, in order of time; after `close` the last ones."""
        ...

    def close(self) -> None:
        """Stop, and disconnect. May be called twice, and at any time."""
        ...


@runtime_checkable
class RunsOn(Protocol):
    """A simulated robot, whose time passes only on request."""

    def run_on(self, ticks: int, tick: float) -> None:
        """Let up to `ticks` times `tick` s of robot time pass, in whole ticks.

        Less time passes if the commanded motion ends, the arm stops itself, the fingers stop or release,
        or the force changes noticeably.
        """
        ...


@runtime_checkable
class Recoverable(Protocol):
    """A robot, or its workplace, that needs a person after a stop."""

    def recover(self) -> None:
        """Continue, after a person has removed the reason of the stop.

        Raises Unavailable: it cannot continue; the message names the remedy.
        """
        ...


@runtime_checkable
class Remembering(Protocol):
    """A robot that records the last seconds of its control loop."""

    def black_box(self) -> Mapping[str, Array] | None:
        """Return the control loop's inputs and outputs of the last seconds before a stop, by name,
        one row a cycle; None without a stop."""
        ...


# Commands as trajectories: the springs' equilibrium as a function of time, for any robot.


STANDING = 1e-4  # m: a shorter motion has no direction, and so no effective mass
# Quintics per second of an arc: the error of the position is less than a micrometre.
ARC_PIECES = 50.0
# s, about 2 d / k of the TCP's springs. A stop this long moves the equilibrium onwards by its lead
# over the arm, so that a contact keeps its force.
GIVING_WAY = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class Arc:
    """Rotation by `angle` rad about the unit `axis` (3,) through a `point` (3,), m, world."""

    axis: Array
    point: Array
    angle: float

    def state(self, start: Array, into_tool: Array, share: MotionState) -> MotionState:
        """Compute position and rotation vector (6,) and their rates after a `share` (1,) of the angle.

        The motion began at `start` (3,), m. `into_tool` (3, 3) rotates into the axes of the hand at the
        start.
        """
        # Split the lever into parts along and across the axis, and rotate the latter.
        angle, rate, change = (self.angle * float(part[0]) for part in share)
        apart = start - self.point
        along = (apart @ self.axis) * self.axis
        across, sideways = apart - along, np.cross(self.axis, apart)
        outwards = np.cos(angle) * across + np.sin(angle) * sideways
        onwards: Array = np.cross(self.axis, outwards).astype(np.float64)
        about = into_tool @ self.axis
        # Position, velocity, and centripetal plus tangential acceleration.
        return MotionState(
            np.concatenate([self.point + along + outwards, angle * about]),
            np.concatenate([rate * onwards, rate * about]),
            np.concatenate([change * onwards - rate**2 * outwards, change * about]),
        )


# Start of a Cartesian motion, and the orientation (4,) that its rotation vector is relative to.
PoseStart = tuple[MotionState, Array]
# Makes a Cartesian motion from its time, s, its start, and the joint positions (7,), rad. The
# second path is that of the null space; None for a posture that stays.
PoseMaker = Callable[[float, PoseStart, Array], tuple[PosePath, PositionPath | None]]


class Commanded:
    """Base class of robots: members of `Robot` that do not depend on the controller."""

    def __init__(self, arm: RobotDescription, nominal: NominalArm, gravity: float) -> None:
        """`gravity`: m/s^2, stated or measured."""
        self._arm, self._nominal, self._gravity = arm, nominal, gravity

    @property
    def limits(self) -> Limits:
        return self._arm.limits

    @property
    def hand(self) -> NominalHand:
        return self._arm.nominal

    @property
    def gravity(self) -> float:
        return self._gravity

    def move_pose(self, target: Pose, speed: float, slower: Sequence[Stretch] = ()) -> None:
        self._start(lambda t, begin, q: self._pose_path(t, begin, target, speed, slower, q))

    def swing(self, about: Array, angle: float, frequency: float, cycles: int) -> None:
        amplitude = np.concatenate([np.zeros(3), angle * np.asarray(about, dtype=float)])

        def make(t: float, begin: PoseStart, _: Array) -> tuple[PosePath, None]:
            now, origin = begin
            return PosePath(swing(t, now, amplitude, frequency, cycles), origin), None

        self._start(make)

    def turn_about(self, axis: Array, point: Array, angle: float, speed: float) -> None:
        arc = Arc(axis, point, angle)
        self._start(lambda t, begin, q: self._arc_path(t, begin, arc, speed, q))

    def move_axis(self, direction: Array, speed: float, travel: float) -> None:
        now, origin = self._pose_begin()
        way = travel * np.asarray(direction, dtype=float)
        self.move_pose(Pose(now.p[:3] + way, origin), speed)

    def _start(self, make: PoseMaker) -> None:
        """Start a Cartesian motion."""
        raise NotImplementedError

    def _pose_begin(self) -> PoseStart:
        """Return the start of a Cartesian motion now."""
        raise NotImplementedError

    def _joint_path(self, t: float, now: MotionState, goal: Array, speed: float) -> PositionPath:
        """Move from `now` at time `t`, s, to joint positions `goal` (7,), rad, at the share `speed` of the
        arm's pace.

        No part of the arm exceeds the pace.
        """
        rates = speed * np.array(joint_rates(self._nominal, self._arm, now.p, goal))
        distance = max(float(np.abs(goal - now.p).max()), 1e-6)
        acceleration = self._arm.pace.joint_acceleration / distance
        return straight(t, now, goal, stretches(rates), acceleration)

    def _pose_path(
        self,
        t: float,
        begin: PoseStart,
        target: Pose,
        speed: float,
        slower: Sequence[Stretch],
        q: Array,
    ) -> tuple[PosePath, PositionPath]:
        """Move straight to `target` (world), with a joint path of the null space from joint positions `q`
        (7,), rad.

        The speed stays within the limits of the arm's effective mass and of `slower`.
        """
        (now, origin), pace = begin, self._arm.pace
        # Goal of the null space, and the turn of the wrist towards it.
        bent = self._nominal.reach(target, self._arm.home)
        turn = wrist_turn(origin, target.quaternion, float(bent[-1] - q[-1]))
        goal = np.concatenate([target.position, turn])
        way = goal[:3] - now.p[:3]
        distance = max(float(np.linalg.norm(way)), 1e-6)
        angle = max(float(np.linalg.norm(goal[3:])), 1e-6)
        # Speed limits in free air, of the turn, and of the caller, as rates per whole motion.
        free = np.array([speed])
        if distance > STANDING:
            free = np.minimum(free_speeds(self._nominal, self._arm, (q, bent), way), speed)
        rates = np.minimum(free / distance, pace.turning_speed / angle)
        limits = [Stretch(part.end, part.speed / distance) for part in slower]
        parts = lower_profile(stretches(rates), limits)
        # TCP and null space move in step: both paths share the rates.
        acceleration = min(pace.acceleration / distance, pace.turning_acceleration / angle)
        path = straight(t, now, goal, parts, acceleration)
        resting = MotionState(q, np.zeros_like(q), np.zeros_like(q))
        return PosePath(path, origin), straight(t, resting, bent, parts, acceleration)

    def _arc_path(
        self, t: float, begin: PoseStart, arc: Arc, speed: float, q: Array
    ) -> tuple[PosePath, PositionPath]:
        """Move the pose along an arc, as `_pose_path` and with the same limits."""
        (now, origin), pace = begin, self._arm.pace
        # End of the arc, and the null space's goal there.
        start, into_tool = now.p[:3], Pose(now.p[:3], origin).rotation.T
        rest = np.zeros(1)
        end = arc.state(start, into_tool, MotionState(np.ones(1), rest, rest))
        target = Pose(end.p[:3], rotate_quaternion(origin, end.p[None, 3:])[0])
        bent = self._nominal.reach(target, self._arm.home)
        # Speed limits as rates per whole arc.
        way, angle = end.p[:3] - start, max(abs(arc.angle), 1e-6)
        length = max(angle * float(np.linalg.norm(np.cross(arc.axis, start - arc.point))), 1e-6)
        free = np.array([speed])
        if np.linalg.norm(way) > STANDING:
            free = np.minimum(free_speeds(self._nominal, self._arm, (q, bent), way), speed)
        parts = stretches(np.minimum(free / length, pace.turning_speed / angle))
        acceleration = min(pace.acceleration / length, pace.turning_acceleration / angle)
        # Profile of the share of the angle, then quintics through states on the arc.
        share = straight(t, MotionState(rest, rest, rest), np.ones(1), parts, acceleration)
        count = max(int(np.ceil((share.end - t) * ARC_PIECES)), 1)
        knots = np.linspace(t, share.end, count + 1)
        states = [arc.state(start, into_tool, share.at(one)) for one in knots.tolist()]
        duration = (share.end - t) / count
        pieces = [quintic(one, other, duration) for one, other in pairwise(states)]
        resting = MotionState(q, np.zeros_like(q), np.zeros_like(q))
        posture = straight(t, resting, bent, parts, acceleration)
        return PosePath(PositionPath(knots, np.array(pieces)), origin), posture

    def _stopped_joints(self, t: float, now: MotionState) -> PositionPath:
        """Stop a joint motion with onward motion."""
        return stop(t, now, self._arm.pace.joint_acceleration)

    def _stopped_pose(self, t: float, begin: PoseStart) -> PosePath:
        """Stop a Cartesian motion with onward motion; a contact keeps its force."""
        now, origin = begin
        return PosePath(stop(t, now, 2 * self._arm.pace.acceleration, GIVING_WAY), origin)

    def _ahead_of(self, pose: Pose, jacobian: Array, torque: Array, twist: Array) -> PoseStart:
        """Compute the equilibrium at which the TCP's springs exert the joint torques `torque` (7,), N m.

        It applies from the first step of a motion at `twist` (6,). Return also its reference orientation.
        """
        # Ahead of the measured pose by force / stiffness, and turned by torque / stiffness.
        springs, pull = self._arm.stiffness, wrench(jacobian, torque)
        ahead = pose.position + pull[:3] / springs.translation
        into_tool = pose.rotation.T
        turn = into_tool @ pull[3:] / springs.rotation
        origin = rotate_quaternion(pose.quaternion, turn[None])[0]
        now = MotionState(
            np.concatenate([ahead, np.zeros(3)]),
            np.concatenate([twist[:3], into_tool @ twist[3:]]),
            np.zeros(6),
        )
        return now, origin
