"""A Franka arm with its hand, behind the protocol that the embedded one has.

It is under torque control all the time that anybody moves it: franky's impedance controllers follow a
`Course`, and a new one takes over without a jerk. Recovery from what stopped the arm is a person's.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from palpate.errors import InputError, Unavailable
from palpate.geometry.pose import Array, Pose
from palpate.robots.commanded import (
    ahead_of,
    joint_path,
    pose_path,
    stopped_joints,
    stopped_pose,
    swing_path,
)
from palpate.robots.description import Limits, RobotDescription
from palpate.robots.franky import faults
from palpate.robots.franky.blackbox import flush
from palpate.robots.franky.course import Course, joint_course, pose_course
from palpate.robots.franky.drive import Drive, Reacted, Row
from palpate.robots.franky.hand import NOTHING, Hand
from palpate.robots.franky.library import Call
from palpate.robots.franky.readout import PERIOD, Readout, pose_of
from palpate.robots.franky.session import Session
from palpate.robots.franky.springs import Springs
from palpate.robots.nominal import NominalArm
from palpate.robots.reflex import Reflex
from palpate.robots.robot import RobotState
from palpate.robots.simulated.impedance import Inertia
from palpate.robots.trajectory import Motion, Path, PosePath, Stretch
from palpate.trace.recording import Hand as NominalHand
from palpate.trace.samples import Samples

SHORTEST, SLICE = 0.001, 0.005
"""s of wall time that are waited for the next cycles at a time."""
OWN_STALL = 0.4
"""s of silence that do not count on a computer without a realtime kernel, or on loopback."""
SILENT = 0.08
"""s of silence beyond that after which the control box is taken for gone: sooner than what it said
last is too old to act upon."""
GAP = 0.03
"""s without a sample."""
ANSWERS = 0.1
"""s in which a control box that ended a motion says in which mode it is."""
APPROACH = 0.25
"""Part of the pace at which the arm goes to its ready pose for the first time: from wherever it was
left, past what nobody has looked at since."""
AT_READY = 0.02
"""rad."""
MATCH, TURNED = 0.002, np.radians(0.5)
"""m, rad between the TCP of the description and that of the control box."""
LOST = "look at the network cable and at Desk"


class FrankyRobot:
    """Implements `palpate.robots.robot.Robot`.

    Attributes:
        flushed: where the last cycles were written when it was closed after a fault.
    """

    flushed: str | None = None

    def __init__(
        self, session: Session, arm: RobotDescription, pose_world_base: Pose, gravity: float
    ) -> None:
        """The arm as it stands; nothing moves.

        Raises:
            InputError: its end effector is not the description's. Unavailable: it is not ready, or
                holds something.
        """
        self._session, self._arm = session, arm
        self._gravity = arm.gravity if arm.gravity is not None else gravity
        self._base = arm.stands(pose_world_base)
        down = np.array([0.0, 0.0, -self._gravity])
        self._nominal = NominalArm(arm, self._base, down)
        state = session.state()
        require_end_effector(state, self._nominal, self._base)
        session.set_thresholds(arm.limits.reflexes.contact, arm.limits.tau_max)
        gains = arm.config.torque_gain if arm.config is not None else None
        self._readout = Readout(
            self._nominal,
            session.model,
            state,
            self._base,
            self._base.rotation.T @ down,
            np.zeros(7) if gains is None else gains.value,
        )
        self._springs = Springs(arm.stiffness)
        self._drive = Drive(session.robot, self._springs, self._base)
        self._hand = Hand(session.gripper, arm.hand)
        require_free(self._hand)
        self._width = self._hand.fingers.width
        self._thresholds = arm.limits.reflexes.contact
        self._reflex: str | None = None
        self._fault: str | None = None
        self._mode = faults.mode_of(state)
        self._guard_due = self._ready = self._closed = self._lost = False
        self._t = self._due = self._t_width = self._sampled = self._readout.stamp
        self._silence = 0.0
        self._slack = 0.0 if session.address.realtime else OWN_STALL
        self._logged: list[Samples] = []
        self._cached: RobotState | None = None

    @property
    def limits(self) -> Limits:
        """The description's."""
        return self._arm.limits

    @property
    def hand(self) -> NominalHand:
        """The nominal hand."""
        return self._arm.nominal

    @property
    def gravity(self) -> float:
        """m/s^2."""
        return self._gravity

    @property
    def longest_stall(self) -> float:
        """s of wall time that two cycles were heard apart at most."""
        return self._drive.longest_stall

    @property
    def cycles(self) -> Sequence[Row]:
        """The last cycles of the control loop."""
        with self._drive.lock:
            return list(self._drive.log)

    @property
    def state(self) -> RobotState:
        """As of the last `advance`."""
        if self._cached is None:
            readout = self._readout
            self._cached = RobotState(
                t=self._t,
                stamp=readout.stamp,
                q=readout.q,
                dq=readout.dq,
                tau=readout.tau,
                tau_ext=readout.tau_ext,
                pose_world_tcp=readout.pose_world_tcp,
                target_world_tcp=self._target(),
                twist=readout.twist,
                wrench=readout.wrench,
                contact=readout.contact,
                width=self._width,
                gripping=self._hand.gripping,
                moving=self._fault is None and self._drive.moving,
                gripper_moving=self._fault is None and self._hand.moving,
                reflex=self._reflex,
                fault=self._fault,
                mode=self._mode,
            )
        return self._cached

    def move_joints(self, q: Array, speed: float = 1.0) -> None:
        """See `Robot`. The first way to the ready pose is slow."""
        goal = np.asarray(q, dtype=float)
        if not self._ready:
            speed *= APPROACH
            self._ready = bool(np.abs(goal - self._arm.home).max() < AT_READY)

        def course(before: Course | None, clock: float) -> Course:
            now = self._joint_motion(before, clock)
            path = joint_path(self._nominal, self._arm, 0.0, now, goal, speed)
            return joint_course(path, self._nominal)

        self._follow(course)

    def move_pose(self, target: Pose, speed: float, slower: Sequence[Stretch] = ()) -> None:
        """See `Robot`."""

        def course(before: Course | None, clock: float) -> Course:
            begin, q = self._pose_motion(before, clock), self._readout.q
            path, posture = pose_path(
                self._nominal, self._arm, 0.0, begin, target, speed, slower, q
            )
            return pose_course(path, posture.sample(posture.knots[-1:])[0], self._base)

        self._follow(course)

    def move_axis(self, direction: Array, speed: float, travel: float) -> None:
        """See `Robot`."""
        now, origin = self._pose_motion(self._drive.course, self._drive.clock)
        ahead = Pose(now.p[:3] + travel * np.asarray(direction, dtype=float), origin)
        self.move_pose(ahead, speed)

    def swing(self, about: Array, angle: float, frequency: float, cycles: int) -> None:
        """See `Robot`."""

        def course(before: Course | None, clock: float) -> Course:
            begin = self._pose_motion(before, clock)
            path = swing_path(0.0, begin, about, angle, frequency, cycles)
            return pose_course(path, self._bent(before), self._base)

        self._follow(course)

    def open_gripper(self) -> None:
        """See `Robot`."""
        if self._fault is None:
            self._hand.open()
        self._cached = None

    def close_gripper(self, force: float | None = None) -> None:
        """See `Robot`."""
        if self._fault is None:
            self._hand.close(force)
        self._cached = None

    def hold(self) -> None:
        """See `Robot`."""
        if not self._drive.moving:
            return

        def course(before: Course | None, clock: float) -> Course:
            assert before is not None
            if isinstance(before.path, Path):
                path = stopped_joints(self._arm, 0.0, before.path.at(clock))
                return joint_course(path, self._nominal)
            stopping = stopped_pose(self._arm, 0.0, self._pose_motion(before, clock))
            return pose_course(stopping, self._bent(before), self._base)

        self._follow(course, clears=False)

    def set_reflex(self, thresholds: Reflex) -> None:
        """See `Robot`: franky's 1 kHz reactions. The control box's own thresholds, which cannot be
        changed while the arm is controlled, stay as wide as touching asks for."""
        if thresholds != self._thresholds:
            self._thresholds, self._guard_due = thresholds, True

    def advance(self, duration: float) -> None:
        """See `Robot`. It never waits for an arm that says nothing: robot time goes on with the
        clock on the wall then."""
        self._due = max(self._due, self._t) + duration
        self._cached = None
        self._renew_guard()
        self._pass_until(self._due)
        if self._fault is None and self._t - self._sampled > GAP:
            # The control loop has just begun: its first cycles make no sample yet.
            self._pass_until(self._t + 2 * PERIOD)

    def _pass_until(self, t: float) -> None:
        while self._t < t:
            self._listen()
        self._take()

    def drain(self) -> Samples:
        """See `Robot`."""
        logged, self._logged = self._logged, []
        return logged[0] if len(logged) == 1 else Samples.concatenate(logged)

    def close(self) -> None:
        """See `Robot`. What the fingers hold, they go on holding."""
        if self._closed:
            return
        self._closed = True
        self._hand.end()
        self._session.close(self._lost)
        if why := self._fault or self._reflex:
            self.flushed = flush(self.cycles, why)

    def _follow(self, make: Callable[[Course | None, float], Course], clears: bool = True) -> None:
        """Take up a course; where nothing moves it is made before the control loop is kept waiting."""
        if self._fault is not None:
            return
        if clears:
            self._reflex = None
        drive = self._drive
        if not drive.moving:
            made = make(drive.course, drive.clock)
            make = _as_made(made)
        try:
            drive.follow(make, self._inertia(), self._thresholds)
        except Exception as error:
            self._fail(faults.of_error(error, self._mode))
        self._guard_due, self._cached = False, None

    def _renew_guard(self) -> None:
        if not self._guard_due or self._fault is not None:
            return
        self._guard_due = False
        try:
            self._drive.guard(self._inertia(), self._thresholds)
        except Exception as error:
            self._fail(faults.of_error(error, self._mode))

    def _listen(self) -> None:
        """Wait for the next cycle, or a while. A silence counts as long as this computer listened."""
        began, heard = time.perf_counter(), self._stamp()
        if self._fault is not None:
            time.sleep(SLICE)
        elif self._drive.begun:
            self._hear_loop()
        else:
            self._ask()
        waited = min(time.perf_counter() - began, 2 * SLICE)
        self._silence = 0.0 if self._stamp() > heard else self._silence + waited
        self._t = max(self._t, self._stamp() + max(self._silence - self._slack, 0.0))
        if self._fault is not None:
            self._t += waited
        elif self._silence > self._slack + SILENT:
            self._lost = True
            self._fail(f"the control box has said nothing for {self._silence:.1f} s: {LOST}")

    def _hear_loop(self) -> None:
        # Woken at every cycle, this thread would keep the one that leads the arm from it.
        time.sleep(min(max(0.5 * (self._due - self._t), SHORTEST), SLICE))
        if not self._session.robot.is_in_control:
            self._loop_ended()

    def _loop_ended(self) -> None:
        """The arm stopped itself, or somebody did."""
        try:
            self._session.robot.join_motion(SLICE)
        except Exception as error:
            self._lost = faults.is_network(error)
            if not self._lost:
                self._ask_mode()
            self._fail(faults.of_error(error, self._mode))
        self._drive.ended()

    def _ask_mode(self) -> None:
        with suppress(Exception):
            state = Call(lambda: self._session.robot.state, "palpate mode").result(ANSWERS)
            self._mode = faults.mode_of(state)

    def _ask(self) -> None:
        """The state of an arm that no loop controls."""
        try:
            state = self._session.robot.state
        except Exception as error:
            self._fail(faults.of_error(error, self._mode))
            return
        if state.time.to_sec() > self._stamp():
            self._idle(Row(state, self._readout.pose_world_tcp.vector, False))
        if reason := faults.of_mode(state):
            self._mode = faults.mode_of(state)
            self._fail(reason)

    def _idle(self, row: Row) -> None:
        with self._drive.lock:
            self._drive.log.append(row)
        self._keep(self._readout.read([row], self._width))

    def _keep(self, samples: Samples) -> None:
        self._logged.append(samples)
        if len(samples):
            self._sampled = float(samples.t[-1])

    def _stamp(self) -> float:
        """s, robot time of the newest cycle."""
        return max(self._readout.stamp, self._drive.last)

    def _take(self) -> None:
        """What the cycles since the last advance said."""
        self._follow_width()
        rows = self._drive.take()
        if rows:
            self._keep(self._readout.read(rows, self._width))
            if self._fault is None:
                self._mode = faults.mode_of(rows[-1].state)
        if self._drive.reacted is not None and self._reflex is None:
            self._reflex = self._why(self._drive.reacted)
        if problem := self._hand.lost or self._hand.problem:
            self._fail(problem)

    def _why(self, how: Reacted) -> str:
        felt = np.array(how.state.O_F_ext_hat_K)
        turn = self._base.rotation
        contact = np.concatenate([turn @ felt[:3], turn @ felt[3:]])
        size = float(np.linalg.norm(contact[:3]))
        return how.thresholds.fired(contact) or (
            f"unexpected contact: the arm stopped itself at {size:.1f} N"
        )

    def _follow_width(self) -> None:
        """The hand speaks more seldom than the arm: between two words its fingers go no faster than
        they can."""
        told, most = (
            self._hand.fingers.width,
            2 * self._arm.hand.speed * (self._due - self._t_width),
        )
        self._width += float(np.clip(told - self._width, -most, most))
        self._t_width = self._due

    def _fail(self, why: str) -> None:
        """The arm does not go on; what the fingers hold, they hold."""
        if self._fault is None:
            self._fault = why
        self._cached = None

    def _target(self) -> Pose:
        course = self._drive.course
        if course is None:
            return self._readout.pose_world_tcp
        row = course.target(self._drive.clock)
        return Pose(row[:3], row[3:])

    def _inertia(self) -> Inertia:
        q = self._readout.q
        return Inertia.of(self._nominal.mass_matrix(q), self._readout.jacobian)

    def _joint_motion(self, before: Course | None, clock: float) -> Motion:
        """Where a joint motion begins: on the present one, or where the joints' springs pull as the
        TCP's do now."""
        if before is not None and isinstance(before.path, Path):
            return before.path.at(clock)
        readout = self._readout
        rate = readout.dq if self._drive.moving else np.zeros(7)
        leading = readout.q + self._sprung(before) / self._arm.stiffness.joints
        return Motion(leading, rate, np.zeros(7))

    def _pose_motion(self, before: Course | None, clock: float) -> tuple[Motion, Array]:
        """Where a Cartesian motion begins: on the present one, or where the TCP's springs pull as
        the joints' do now."""
        if before is not None and isinstance(before.path, PosePath):
            return before.path.motion(clock), before.path.pose(clock).quaternion
        readout = self._readout
        twist = readout.twist if self._drive.moving else np.zeros(6)
        springs, torque = self._arm.stiffness, self._sprung(before)
        return ahead_of(readout.pose_world_tcp, readout.jacobian, torque, springs, twist)

    def _sprung(self, before: Course | None) -> Array:
        """(7,) N m that the springs exert at the joints now."""
        return self._readout.commanded if before is not None else np.zeros(7)

    def _bent(self, before: Course | None) -> Array:
        return self._readout.q if before is None or before.bent is None else before.bent


def require_free(hand: Hand) -> None:
    """That nothing is in the hand.

    Raises:
        Unavailable: it holds something.
    """
    fingers = hand.fingers
    if fingers.grasped and fingers.width > NOTHING:
        hand.end()
        raise Unavailable(
            f"the hand holds something at {1e3 * fingers.width:.0f} mm: take it out (Desk opens the "
            "fingers), then run again"
        )


def require_end_effector(state: Any, nominal: NominalArm, pose_world_base: Pose) -> float:
    """That the control box means the same TCP; m that is between the two.

    Raises:
        InputError: it does not.
    """
    row = nominal.poses(np.array(state.q)[None])[0]
    mine, theirs = Pose(row[:3], row[3:]), pose_world_base @ pose_of(state.O_T_EE)
    away, turned = mine.distance_to(theirs), mine.angle_to(theirs)
    if away > MATCH or turned > TURNED:
        raise InputError(
            f"the end effector that Desk is set to has its TCP {1e3 * away:.1f} mm and "
            f"{np.degrees(turned):.1f}° from where the arm's description has it: set the Franka Hand as "
            "end effector in Desk, or describe the one that is there (docs/arms.md)"
        )
    return away


def _as_made(course: Course) -> Callable[[Course | None, float], Course]:
    return lambda before, clock: course
