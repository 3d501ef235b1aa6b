"""The 1 kHz control loop of the arm, and the table of references that it follows."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from palpate.common.pose import Array, Pose
from palpate.robots.franky.control_box import franky
from palpate.robots.nominal import NominalArm
from palpate.robots.sheet import ControllerStiffness, Reflex
from palpate.robots.springs import POSTURE_RATE, SpringGains, SpringInertia
from palpate.robots.trajectory import PosePath, PositionPath, quaternion_matrix, rotate_quaternion

CYCLE = 0.001  # s of a control cycle
COARSE = 5  # cycles between two logged target poses of a joint motion


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """A motion's references in the base's frame."""

    path: PositionPath | PosePath  # its time begins at 0
    posture: Array | None  # (7,) rad, goal of the null space in a Cartesian motion
    rows: Array  # (m, 7) joint positions, or positions and quaternions xyzw
    rates: Array  # (m, 7) rad/s, or (m, 6) twists
    poses_world_tcp: Array  # (k, 7) commanded TCP poses, one each `every` rows
    every: int

    @property
    def last(self) -> int:
        """Index of the row at which the motion is at rest."""
        return len(self.rows) - 1

    def reference(self, clock: float) -> Any:
        """Return franky's reference `clock` s after the beginning."""
        i, module = self.row(clock), franky()
        row, rate = self.rows[i], self.rates[i]
        if self.posture is None:
            return module.JointReference(q=row, dq=rate)
        twist = module.Twist(rate[:3], rate[3:])
        return module.CartesianReference(module.Affine(row[:3], row[3:]), twist)

    def row(self, clock: float) -> int:
        """Return the index of the row that is due."""
        return min(round(clock / CYCLE), self.last)

    def target(self, clock: float) -> Array:
        """Return the commanded pose (7,) of the TCP, world."""
        i = min(self.row(clock) // self.every, len(self.poses_world_tcp) - 1)
        return self.poses_world_tcp[i]


def joint_course(path: PositionPath, nominal: NominalArm) -> Course:
    """Make a course for the joints' springs."""
    rows = path.sample(cycle_times(path))
    poses = nominal.poses(rows[::COARSE] if len(rows) > 1 else rows)
    if len(rows) > 1:
        poses = np.concatenate([poses, nominal.poses(rows[-1:])])
    return Course(path, None, rows, row_rates(rows), poses, COARSE)


def pose_course(path: PosePath, posture: Array, pose_world_base: Pose) -> Course:
    """Make a course for the TCP's springs."""
    coordinates = path.path.sample(cycle_times(path.path))
    quaternions = np.array(rotate_quaternion(path.origin, coordinates[:, 3:]))
    poses = np.concatenate([coordinates[:, :3], quaternions], axis=1)
    rates = row_rates(coordinates)
    into_base = pose_world_base.rotation.T
    positions = (poses[:, :3] - pose_world_base.position) @ into_base.T
    # Positions and orientations in the base's frame.
    conjugate = pose_world_base.quaternion * [1.0, -1.0, -1.0, -1.0]
    turns = quaternions @ quaternion_matrix(conjugate).T
    # Rotation vectors are in the origin's frame; twists in the base's.
    to_base = into_base @ Pose(np.zeros(3), path.origin).rotation
    twists = np.concatenate([rates[:, :3] @ into_base.T, rates[:, 3:] @ to_base.T], axis=1)
    # franky's quaternions are xyzw.
    rows = np.concatenate([positions, turns[:, 1:], turns[:, :1]], axis=1)
    return Course(path, posture, rows, twists, poses, 1)


def cycle_times(path: PositionPath) -> Array:
    """Return the times of all cycles of a path."""
    count = max(0, int(np.ceil((path.end - path.knots[0]) / CYCLE - 1e-9)))
    return path.knots[0] + CYCLE * np.arange(count + 1.0)


def row_rates(rows: Array) -> Array:
    """Differentiate the rows by central differences; the last row is at rest."""
    if len(rows) < 3:
        return np.zeros_like(rows)
    rates = np.gradient(rows, CYCLE, axis=0)
    rates[-1] = 0.0
    return rates


# Control loop of the arm: franky's controllers at 1 kHz, which follow a course cycle by cycle.


STALLED = 0.003  # s of wall time between two callbacks after which the queue may be behind
BEHIND = 0.003  # s of robot time by which the queue's state is behind the loop's
KEPT = 5000  # cycles in the log: the last 5 s
CLIPS = (np.full(3, 0.1), np.full(3, 0.5))  # m, rad: largest deflection of the springs
TORQUE_STEP = 0.8  # N m, largest change of a commanded torque per cycle; libfranka refuses 1 N m
BLENDING = 0.1  # s, time constant with which stiffness changes


class CycleRow(NamedTuple):
    """Record of one cycle."""

    state: Any  # franky's
    target: Array  # (7,) the commanded equilibrium


@dataclass(frozen=True, slots=True, eq=False)
class Reacted:
    """Reflex of the arm: its state, and the thresholds."""

    state: Any
    thresholds: Reflex


class Drive:
    """Follows courses. All methods except the constructor may be called in any thread.

    Attributes:
        lock: guards all attributes below.
        log: the last cycles.
        reacted: reflex since the last course was given; None without one.
        begun: True if a control loop was started and its end was not noticed yet.
        course: current course; None before the first one, and after a reflex.
        clock: s since the beginning of the course.
        last: s, robot time of the newest cycle.
    """

    def __init__(self, arm: Any, stiffness: ControllerStiffness, pose_world_base: Pose) -> None:
        self._arm, self._stiffness = arm, stiffness
        self._turn = pose_world_base.rotation
        self.lock = threading.RLock()
        self.log: deque[CycleRow] = deque(maxlen=KEPT)
        self.reacted: Reacted | None = None
        self.course: Course | None = None
        self.begun, self.clock, self.last = False, 0.0, 0.0
        self._rows: list[CycleRow] = []
        self._heard = 0.0  # `time.perf_counter` of the last callback
        self._late = False
        self._motion: Any = None

    @property
    def moving(self) -> bool:
        """Test if the course has not ended."""
        course = self.course
        return course is not None and course.row(self.clock) < course.last

    def take(self) -> list[CycleRow]:
        """Return the cycles since the last call."""
        with self.lock:
            rows, self._rows = self._rows, []
        return rows

    def follow(
        self, make: Callable[[Course | None, float], Course], inertia: SpringInertia, reflex: Reflex
    ) -> None:
        """Follow the course that `make` makes from the present one and its clock."""
        with self.lock:
            before = self.course
            course = make(before, self.clock)
            self.course, self.clock, self.reacted = course, 0.0, None
            held = None if before is None else before.posture
            self._enter(course, inertia, reflex, held is None or course.posture is not held)

    def guard(self, inertia: SpringInertia, reflex: Reflex) -> None:
        """Change the thresholds of the reflex."""
        with self.lock:
            if self.course is not None and self.begun:
                self._enter(self.course, inertia, reflex, blends=False)

    def note_end(self) -> None:
        """Discard the course: the loop has ended."""
        with self.lock:
            self.course, self._motion, self.begun = None, None, False

    def _enter(self, course: Course, inertia: SpringInertia, reflex: Reflex, blends: bool) -> None:
        """Start franky's controller for the course; with `blends` the posture's spring fades in."""
        make = self._joint_controller if course.posture is None else self._pose_controller
        motion = make(course, inertia, blends)
        motion.set_reference(course.reference(self.clock))
        motion.register_callback(self._cycle)
        self._react(motion, reflex)
        self._motion = motion
        self._arm.move(motion, asynchronous=True)
        self.begun, self._heard = True, time.perf_counter()

    def _joint_controller(self, course: Course, inertia: SpringInertia, blends: bool) -> Any:
        gains = SpringGains.of_joints(self._stiffness, inertia)
        return franky().JointImpedanceTrackingMotion(
            stiffness=gains.stiffness,
            damping=gains.damping,
            max_delta_tau=TORQUE_STEP,
            gains_time_constant=BLENDING,
        )

    def _pose_controller(self, course: Course, inertia: SpringInertia, blends: bool) -> Any:
        module, own = franky(), np.diag(inertia.joints)
        stiffness, damping = POSTURE_RATE**2 * own, 2 * POSTURE_RATE * own
        share = 1e-3 if blends else 1.0
        motion = module.CartesianImpedanceTrackingMotion(
            translational_stiffness=self._stiffness.translation,
            rotational_stiffness=self._stiffness.rotation,
            posture_task=module.PostureTask(course.posture, share * stiffness, damping),
            translational_error_clip=CLIPS[0],
            rotational_error_clip=CLIPS[1],
            max_delta_tau=TORQUE_STEP,
            gains_time_constant=BLENDING,
        )
        gains = SpringGains.of_tcp(self._stiffness, inertia)
        diagonal = module.CartesianImpedanceGains.diagonal(gains.stiffness, gains.damping)
        motion.set_gains(diagonal)
        if blends:
            null_space = motion.get_nullspace_gains()
            null_space.posture_stiffness = stiffness
            motion.set_nullspace_gains(null_space)
        return motion

    def _react(self, motion: Any, reflex: Reflex) -> None:
        """Stop within the next cycle after a threshold is exceeded; see `Reflex.fired`.

        franky's conditions cannot measure torques: the control box's own thresholds cover them.
        """
        module = franky()
        # Squared force, and its vertical component in the base's frame.
        f, up = module.Measure, self._turn[2]
        size = f.FORCE_X**2.0 + f.FORCE_Y**2.0 + f.FORCE_Z**2.0
        lift = f.FORCE_X * float(up[0]) + f.FORCE_Y * float(up[1]) + f.FORCE_Z * float(up[2])
        most, load = reflex.force**2, reflex.load
        # The allowed load reduces an upward force; beyond it only the excess counts.
        beyond = size - 2.0 * load * lift + load**2
        too_much = (size > most) & (lift <= 0.0)
        too_much = too_much | ((beyond > most) & (lift > load))
        too_much = too_much | ((size - lift**2.0 > min(most, reflex.sideways**2)) & (lift > 0.0))
        if np.isfinite(reflex.sideways):
            too_much = too_much | (size - lift**2.0 > reflex.sideways**2)
        # A force that was present at the start must also have changed.
        if any(reflex.pressed):
            x, y, z = (self._turn.T @ reflex.pressed).tolist()
            changed = (f.FORCE_X - x) ** 2.0 + (f.FORCE_Y - y) ** 2.0 + (f.FORCE_Z - z) ** 2.0
            too_much = too_much & (changed > most)
        reaction = module.TorqueReaction(too_much, module.TorqueStopMotion())

        def react(state: Any, *_: Any) -> None:
            with self.lock:
                self.reacted = Reacted(state, reflex)
                self.course, self._motion = None, None

        reaction.register_callback(react)
        motion.add_reaction(reaction)

    def _cycle(self, state: Any, *_: Any) -> None:
        """Advance the course after a cycle. It must not raise."""
        with self.lock:
            # A gap between callbacks may mean that the queue lags behind the control loop.
            heard, now = time.perf_counter(), state.time.to_sec()
            gap, self._heard = heard - self._heard, heard
            passed, self.last = now - self.last, now
            self._late = self._late or gap > STALLED
            if self._late:
                self._late = self._arm.state.time.to_sec() - now > BEHIND
            course = self.course
            if course is None:
                return
            # While it lags, the reference stays; otherwise the course advances by at most a cycle.
            if not self._late and self._motion is not None:
                was = course.row(self.clock)
                self.clock += min(max(passed, 0.0), CYCLE)
                if course.row(self.clock) != was:
                    self._motion.set_reference(course.reference(self.clock))
            row = CycleRow(state, course.target(self.clock))
            self.log.append(row)
            self._rows.append(row)
