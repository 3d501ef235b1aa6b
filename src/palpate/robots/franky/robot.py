"""A Franka arm with its hand, behind the protocol that the embedded one has.

It is under torque control all the time that anybody moves it: franky's impedance controllers follow a
`Course`, and a new one takes over without a jerk. Recovery from what stopped the arm is a person's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from palpate.geometry.pose import Array, Pose
from palpate.robots.commanded import Commanded
from palpate.robots.description import RobotDescription
from palpate.robots.franky.blackbox import black_box
from palpate.robots.franky.control.course import Course
from palpate.robots.franky.control.drive import Drive, Row
from palpate.robots.franky.control.lead import Lead, Maker
from palpate.robots.franky.control.springs import Springs
from palpate.robots.franky.fitness import require_end_effector, require_free
from palpate.robots.franky.hand import Hand
from palpate.robots.franky.link import Link
from palpate.robots.franky.readout import Readout
from palpate.robots.franky.session import Session
from palpate.robots.nominal import NominalArm
from palpate.robots.reflex import Reflex
from palpate.robots.robot import RobotState
from palpate.robots.trajectory.straight import Stretch
from palpate.trace.samples import Samples

APPROACH = 0.25
"""Part of the pace at which the arm goes to its ready pose for the first time: from wherever it was
left, past what nobody has looked at since."""
AT_READY = 0.02
"""rad."""


class FrankyRobot(Commanded):
    """Implements `palpate.robots.robot.Robot`, `Recoverable` and `Remembering`."""

    def __init__(
        self, session: Session, arm: RobotDescription, pose_world_base: Pose, gravity: float
    ) -> None:
        """The arm as it stands; nothing moves.

        Raises:
            InputError: its end effector is not the description's.
            Unavailable: it is not ready, or holds something.
        """
        base = arm.stands(pose_world_base)
        known = arm.gravity if arm.gravity is not None else gravity
        down = np.array([0.0, 0.0, -known])
        super().__init__(arm, NominalArm(arm, base, down), known)
        self._session = session
        state = session.state()
        require_end_effector(state, self._nominal, base)
        session.set_thresholds(arm.limits.reflexes.contact, arm.limits.tau_max)
        gains = arm.config.torque_gain if arm.config is not None else None
        self._readout = Readout(
            self._nominal,
            session.model,
            state,
            base,
            base.rotation.T @ down,
            np.zeros(7) if gains is None else gains.value,
        )
        self._drive = Drive(session.robot, Springs(arm.stiffness), base)
        self._hand = Hand(session.gripper, arm.hand)
        require_free(self._hand)
        self._lead = Lead(arm, self._nominal, base, self._readout, self._drive)
        self._link = Link(session, self._readout, self._drive, self._hand, base.rotation)
        self._thresholds = arm.limits.reflexes.contact
        self._guard_due = self._ready = self._closed = False
        self._cached: RobotState | None = None

    @property
    def cycles(self) -> Sequence[Row]:
        """The last cycles of the control loop."""
        with self._drive.lock:
            return list(self._drive.log)

    @property
    def state(self) -> RobotState:
        """State as of the last `advance`."""
        if self._cached is None:
            readout, link = self._readout, self._link
            self._cached = RobotState(
                t=link.t,
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
                width=link.width,
                gripping=self._hand.gripping,
                moving=link.fault is None and self._drive.moving,
                gripper_moving=link.fault is None and self._hand.moving,
                reflex=link.reflex,
                fault=link.fault,
                mode=link.mode,
            )
        return self._cached

    def move_joints(self, q: Array, speed: float = 1.0) -> None:
        """See `Robot`. The first way to the ready pose is slow."""
        goal = np.asarray(q, dtype=float)
        if not self._ready:
            speed *= APPROACH
            self._ready = bool(np.abs(goal - self._arm.home).max() < AT_READY)
        self._follow(self._lead.to_joints(goal, speed))

    def move_pose(self, target: Pose, speed: float, slower: Sequence[Stretch] = ()) -> None:
        """See `Robot`."""
        self._follow(self._lead.to_pose(target, speed, slower))

    def swing(self, about: Array, angle: float, frequency: float, cycles: int) -> None:
        """See `Robot`."""
        self._follow(self._lead.swinging(about, angle, frequency, cycles))

    def open_gripper(self) -> None:
        """See `Robot`."""
        if self._link.fault is None:
            self._hand.open()
        self._cached = None

    def close_gripper(self, force: float | None = None) -> None:
        """See `Robot`."""
        if self._link.fault is None:
            self._hand.close(force)
        self._cached = None

    def hold(self) -> None:
        """See `Robot`."""
        if self._drive.moving:
            self._follow(self._lead.stopping(), clears=False)

    def set_reflex(self, thresholds: Reflex) -> None:
        """See `Robot`: franky's 1 kHz reactions. The control box's own thresholds, which cannot be
        changed while the arm is controlled, stay as wide as touching asks for."""
        if thresholds != self._thresholds:
            self._thresholds, self._guard_due = thresholds, True

    def advance(self, duration: float) -> None:
        """See `Robot`. It never waits for an arm that says nothing."""
        self._cached = None
        self._renew_guard()
        self._link.advance(duration)

    def drain(self) -> Samples:
        """See `Robot`."""
        return self._link.drain()

    def recover(self) -> None:
        """See `Recoverable`. It goes to its ready pose as slowly as the first time.

        Raises:
            Unavailable: it cannot go on.
        """
        self._session.recover()
        self._link.taken_up()
        self._ready, self._cached = False, None

    def black_box(self) -> Mapping[str, Array] | None:
        """See `Remembering`."""
        why = self._link.fault or self._link.reflex
        return None if why is None else black_box(self.cycles, why)

    def close(self) -> None:
        """See `Robot`. What the fingers hold, they go on holding."""
        if self._closed:
            return
        self._closed = True
        self._hand.end()
        self._session.close(self._link.lost)

    def _pose_begin(self) -> tuple[Array, Array]:
        now, origin = self._lead.begin()
        return now.p[:3], origin

    def _follow(self, make: Maker, clears: bool = True) -> None:
        """Take up a course; where nothing moves it is made before the control loop is kept waiting."""
        link, drive = self._link, self._drive
        if link.fault is not None:
            return
        if clears:
            link.reflex = None
        if not drive.moving:
            make = _as_made(make(drive.course, drive.clock))
        try:
            drive.follow(make, self._lead.inertia(), self._thresholds)
        except Exception as error:
            link.failed(error)
        self._guard_due, self._cached = False, None

    def _renew_guard(self) -> None:
        if not self._guard_due or self._link.fault is not None:
            return
        self._guard_due = False
        try:
            self._drive.guard(self._lead.inertia(), self._thresholds)
        except Exception as error:
            self._link.failed(error)

    def _target(self) -> Pose:
        course = self._drive.course
        if course is None:
            return self._readout.pose_world_tcp
        row = course.target(self._drive.clock)
        return Pose(row[:3], row[3:])


def _as_made(course: Course) -> Maker:
    return lambda before, clock: course
