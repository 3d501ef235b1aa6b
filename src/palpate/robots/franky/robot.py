"""A Franka arm with its hand, behind the same protocol as the embedded arm.

While commanded, it is under torque control: franky's impedance controllers follow a `Course`. The next
course continues from the state of the last one without a jerk. Only a person can recover it after a stop.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from palpate.common.errors import InputError
from palpate.common.pose import Array, Pose
from palpate.robots.description import RobotDescription
from palpate.robots.franky.drive import Course, CycleRow, Drive, joint_course, pose_course
from palpate.robots.franky.link import HandThread, StateListener
from palpate.robots.franky.session import (
    FrankySession,
    StateReadout,
    black_box,
    require_end_effector,
)
from palpate.robots.nominal import NominalArm, explain_torque
from palpate.robots.robot import Commanded, PoseMaker, PoseStart, RobotState
from palpate.robots.sheet import Reflex
from palpate.robots.springs import SpringInertia
from palpate.robots.trajectory import MotionState, PosePath, PositionPath
from palpate.trace.samples import Samples

# Share of the pace at which the arm first moves to its ready pose: its start and surroundings are
# unknown.
APPROACH = 0.25
AT_READY = 0.02  # rad from home that counts as the ready pose

# Makes a course from the present one and its clock, s.
Maker = Callable[[Course | None, float], Course]


class FrankyRobot(Commanded):
    """Implements `palpate.robots.robot.Robot`, `Recoverable` and `Remembering`."""

    def __init__(
        self, session: FrankySession, arm: RobotDescription, pose_world_base: Pose, gravity: float
    ) -> None:
        """Take over the arm; it does not move.

        Raises:
            InputError: its end effector differs from the description's.
            Unavailable: it is not ready, or holds an object.
        """
        if arm.wrench_sensor is not None:
            raise InputError(
                f"the driver of Franka arms does not read a six-axis sensor: '{arm.name}' has one, use an arm without"
            )
        base = self._base = arm.stands(pose_world_base)
        known = arm.gravity if arm.gravity is not None else gravity
        down = np.array([0.0, 0.0, -known])
        super().__init__(arm, NominalArm(arm, base, down), known)
        self._session = session
        # The control box must have the description's TCP, and its own widest thresholds.
        state = session.state()
        require_end_effector(state, self._nominal, base)
        session.set_thresholds(arm.limits.reflexes.contact, arm.limits.tau_max)
        gains = arm.config.torque_gain if arm.config is not None else None
        self._readout = StateReadout(
            nominal=self._nominal,
            model=session.model,
            state=state,
            pose_world_base=base,
            gravity=base.rotation.T @ down,
            gains=np.zeros(7) if gains is None else gains.value,
        )
        self._drive = Drive(session.robot, arm.stiffness, base)
        self._hand = HandThread(session.gripper, arm.hand)
        self._hand.require_free()
        self._link = StateListener(session, self._readout, self._drive, self._hand, base.rotation)
        self._thresholds = arm.limits.reflexes.contact
        self._guard_due = self._ready = self._closed = False
        self._cached: RobotState | None = None

    @property
    def cycles(self) -> Sequence[CycleRow]:
        """The last cycles of the control loop."""
        with self._drive.lock:
            return list(self._drive.log)

    @property
    def state(self) -> RobotState:
        """State as of the last `advance`."""
        if self._cached is None:
            readout, link, course = self._readout, self._link, self._drive.course
            target = readout.pose_world_tcp
            if course is not None:
                row = course.target(self._drive.clock)
                target = Pose(row[:3], row[3:])
            self._cached = RobotState(
                t=link.t,
                stamp=readout.stamp,
                q=readout.q,
                dq=readout.dq,
                tau=readout.tau,
                tau_ext=readout.tau_ext,
                pose_world_tcp=readout.pose_world_tcp,
                target_world_tcp=target,
                twist=readout.twist,
                wrench=readout.wrench,
                contact=readout.contact,
                width=link.width,
                gripping=self._hand.gripping,
                moving=link.fault is None and self._drive.moving,
                gripper_moving=link.fault is None and self._hand.moving,
                reflex=link.reflex,
                fault=link.fault,
                mode=link.mode,
                unexplained=explain_torque(readout.jacobian, readout.contact_torque),
            )
        return self._cached

    def move_joints(self, q: Array, speed: float = 1.0) -> None:
        """Move the joints; the first motion to the ready pose is slow."""
        goal = np.asarray(q, dtype=float)
        if not self._ready:
            speed *= APPROACH
            self._ready = bool(np.abs(goal - self._arm.home).max() < AT_READY)

        def course(before: Course | None, clock: float) -> Course:
            if before is not None and isinstance(before.path, PositionPath):
                now = before.path.at(clock)
            else:  # set-points at which the joints' springs exert the torques that the TCP's springs exert now
                rate = self._readout.dq if self._drive.moving else np.zeros(7)
                lead = self._spring_torque(before) / self._arm.stiffness.joints
                now = MotionState(self._readout.q + lead, rate, np.zeros(7))
            return joint_course(self._joint_path(0.0, now, goal, speed), self._nominal)

        self._follow(course)

    def open_gripper(self, width: float | None = None) -> None:
        if self._link.fault is None:
            self._hand.open(width)
        self._cached = None

    def close_gripper(self, force: float | None = None) -> None:
        if self._link.fault is None:
            self._hand.close(force)
        self._cached = None

    def hold(self) -> None:

        def course(before: Course | None, clock: float) -> Course:
            assert before is not None
            if isinstance(before.path, PositionPath):
                path = self._stopped_joints(0.0, before.path.at(clock))
                return joint_course(path, self._nominal)
            stopping = self._stopped_pose(0.0, self._pose_motion(before, clock))
            return pose_course(stopping, self._posture(before), self._base)

        if self._drive.moving:
            self._follow(course)

    def set_reflex(self, thresholds: Reflex) -> None:
        """Set franky's 1 kHz reactions.

        The control box's own thresholds cannot be changed while the arm is controlled. They stay as wide
        as contact needs.
        """
        if thresholds != self._thresholds:
            self._thresholds, self._guard_due = thresholds, True

    def advance(self, duration: float) -> None:
        """Let time pass; it never blocks on a silent arm."""
        self._cached = None
        if self._guard_due and self._link.fault is None:
            self._guard_due = False
            try:
                self._drive.guard(self._inertia(), self._thresholds)
            except Exception as error:
                self._link.fail(error)
        self._link.advance(duration)

    def drain(self) -> Samples:
        return self._link.drain()

    def recover(self) -> None:
        """Continue after a stop; the arm moves to its ready pose as slowly as at first."""
        self._session.recover()
        self._link.taken_up()
        self._ready, self._cached = False, None

    def black_box(self) -> Mapping[str, Array] | None:
        why = self._link.fault or self._link.reflex
        return None if why is None else black_box(self.cycles, why)

    def close(self) -> None:
        """End the control; a held object stays held."""
        if self._closed:
            return
        self._closed = True
        self._hand.end()
        self._session.close(self._link.lost)

    def _start(self, make: PoseMaker) -> None:

        def course(before: Course | None, clock: float) -> Course:
            begin = self._pose_motion(before, clock)
            path, posture = make(0.0, begin, self._readout.q)
            # franky's posture task takes the goal of the null space alone.
            goal = self._posture(before) if posture is None else posture.at(posture.end).p
            return pose_course(path, goal, self._base)

        self._follow(course)

    def _pose_begin(self) -> PoseStart:
        return self._pose_motion(self._drive.course, self._drive.clock)

    def _pose_motion(self, before: Course | None, clock: float) -> PoseStart:
        """Return the start of a Cartesian motion.

        The start is the state of the course `before`, or set-points at which the TCP's springs exert the
        torques that the joints' springs exert now.
        """
        if before is not None and isinstance(before.path, PosePath):
            return before.path.motion(clock), before.path.pose(clock).quaternion
        readout, torque = self._readout, self._spring_torque(before)
        twist = readout.twist if self._drive.moving else np.zeros(6)
        return self._ahead_of(readout.pose_world_tcp, readout.jacobian, torque, twist)

    def _spring_torque(self, before: Course | None) -> Array:
        """Return the torques (7,), N m, that the springs exert at the joints now."""
        return self._readout.commanded if before is not None else np.zeros(7)

    def _posture(self, before: Course | None) -> Array:
        return self._readout.q if before is None or before.posture is None else before.posture

    def _inertia(self) -> SpringInertia:
        return SpringInertia.of(self._nominal.mass_matrix(self._readout.q), self._readout.jacobian)

    def _follow(self, make: Maker) -> None:
        """Follow a course. For an arm at rest, make it before the control loop has to wait."""
        link, drive = self._link, self._drive
        if link.fault is not None:
            return
        link.reflex = None
        if not drive.moving:
            course = make(drive.course, drive.clock)
            make = lambda before, clock: course  # noqa: E731
        try:
            drive.follow(make, self._inertia(), self._thresholds)
        except Exception as error:
            link.fail(error)
        self._guard_due, self._cached = False, None
