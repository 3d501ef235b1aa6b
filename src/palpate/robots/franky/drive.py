"""The arm's control loop: franky's controllers at 1 kHz, led along a course cycle by cycle.

franky calls back after every cycle, in its own thread, from a queue. The course is led by the loop's
latest state: while the queue is behind, as after a stall of this computer, states are logged and the
reference waits.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from palpate.geometry.pose import Array, Pose
from palpate.robots.franky.course import CYCLE, Course
from palpate.robots.franky.library import franky
from palpate.robots.reflex import Reflex
from palpate.robots.sheet import Stiffness
from palpate.robots.simulated.impedance import POSTURE_RATE, Gains, Inertia

STALLED = 0.003  # s of wall time between two callbacks after which the queue may be behind
BEHIND = 0.003  # s of robot time by which the queue's state is behind the loop's
KEPT = 5000  # cycles in the log: the last 5 s
CLIPS = (np.full(3, 0.1), np.full(3, 0.5))  # m, rad: largest stretch of the springs
TORQUE_STEP = 0.8  # N m, largest change of a commanded torque per cycle; libfranka refuses 1 N m
BLENDING = 0.1  # s, time constant with which springs change


class Row(NamedTuple):
    """Record of one cycle."""

    state: Any  # franky's
    target: Array  # (7,) the commanded equilibrium


@dataclass(frozen=True, slots=True, eq=False)
class Reacted:
    """Reflex of the arm: its state, and the thresholds."""

    state: Any
    thresholds: Reflex


class Drive:
    """Follows courses. All but the constructor may be called in any thread.

    Attributes:
        lock: guards all that follows.
        log: the last cycles.
        reacted: reflex since the last course was given; None without one.
        begun: True if a control loop was started and has not been seen to end.
        course: current course; None before the first one, and after a reflex.
        clock: s since the course was begun.
        last: s, robot time of the newest cycle.
    """

    def __init__(self, arm: Any, stiffness: Stiffness, pose_world_base: Pose) -> None:
        self._arm, self._stiffness = arm, stiffness
        self._turn = pose_world_base.rotation
        self.lock = threading.RLock()
        self.log: deque[Row] = deque(maxlen=KEPT)
        self.reacted: Reacted | None = None
        self.course: Course | None = None
        self.begun, self.clock, self.last = False, 0.0, 0.0
        self._rows: list[Row] = []
        self._heard = 0.0  # `time.perf_counter` of the last callback
        self._late = False
        self._motion: Any = None

    @property
    def moving(self) -> bool:
        """True until the course has ended."""
        course = self.course
        return course is not None and course.row(self.clock) < course.last

    def take(self) -> list[Row]:
        """Return the cycles since the last call."""
        with self.lock:
            rows, self._rows = self._rows, []
        return rows

    def follow(
        self, make: Callable[[Course | None, float], Course], inertia: Inertia, reflex: Reflex
    ) -> None:
        """Follow the course that `make` makes of the present one and of its clock.

        Raises:
            Exception: franky's.
        """
        with self.lock:
            before = self.course
            course = make(before, self.clock)
            self.course, self.clock, self.reacted = course, 0.0, None
            held = None if before is None else before.posture
            self._enter(course, inertia, reflex, held is None or course.posture is not held)

    def guard(self, inertia: Inertia, reflex: Reflex) -> None:
        """Change the thresholds of the reflex."""
        with self.lock:
            if self.course is not None and self.begun:
                self._enter(self.course, inertia, reflex, blends=False)

    def ended(self) -> None:
        """Forget the course: the loop has ended."""
        with self.lock:
            self.course, self._motion, self.begun = None, None, False

    def _enter(self, course: Course, inertia: Inertia, reflex: Reflex, blends: bool) -> None:
        """Start franky's controller for the course; `blends`: the posture's spring fades in."""
        make = self._joint_controller if course.posture is None else self._pose_controller
        motion = make(course, inertia, blends)
        motion.set_reference(course.reference(self.clock))
        motion.register_callback(self._cycle)
        self._react(motion, reflex)
        self._motion = motion
        self._arm.move(motion, asynchronous=True)
        self.begun, self._heard = True, time.perf_counter()

    def _joint_controller(self, course: Course, inertia: Inertia, blends: bool) -> Any:
        gains = Gains.of_joints(self._stiffness, inertia)
        return franky().JointImpedanceTrackingMotion(
            stiffness=gains.stiffness,
            damping=gains.damping,
            max_delta_tau=TORQUE_STEP,
            gains_time_constant=BLENDING,
        )

    def _pose_controller(self, course: Course, inertia: Inertia, blends: bool) -> Any:
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
        gains = Gains.of_tcp(self._stiffness, inertia)
        diagonal = module.CartesianImpedanceGains.diagonal(gains.stiffness, gains.damping)
        motion.set_gains(diagonal)
        if blends:
            null_space = motion.get_nullspace_gains()
            null_space.posture_stiffness = stiffness
            motion.set_nullspace_gains(null_space)
        return motion

    def _react(self, motion: Any, reflex: Reflex) -> None:
        """Stop within the next cycle once the thresholds are exceeded; see `Reflex.fired`. franky's
        conditions cannot measure torques: the control box's own thresholds do."""
        module = franky()
        f, up = module.Measure, self._turn[2]
        size = f.FORCE_X**2.0 + f.FORCE_Y**2.0 + f.FORCE_Z**2.0
        lift = f.FORCE_X * float(up[0]) + f.FORCE_Y * float(up[1]) + f.FORCE_Z * float(up[2])
        most, load = reflex.force**2, reflex.load
        beyond = size - 2.0 * load * lift + load**2
        too_much = (size > most) & (lift <= 0.0)
        too_much = too_much | ((beyond > most) & (lift > load))
        too_much = too_much | ((size - lift**2.0 > min(most, reflex.sideways**2)) & (lift > 0.0))
        if np.isfinite(reflex.sideways):
            too_much = too_much | (size - lift**2.0 > reflex.sideways**2)
        if any(reflex.pressed):
            x, y, z = (self._turn.T @ reflex.pressed).tolist()
            changed = (f.FORCE_X - x) ** 2.0 + (f.FORCE_Y - y) ** 2.0 + (f.FORCE_Z - z) ** 2.0
            too_much = too_much & (changed > most)
        reaction = module.TorqueReaction(too_much, module.TorqueStopMotion())

        def reacted(state: Any, *_: Any) -> None:
            with self.lock:
                self.reacted = Reacted(state, reflex)
                self.course, self._motion = None, None

        reaction.register_callback(reacted)
        motion.add_reaction(reaction)

    def _cycle(self, state: Any, *_: Any) -> None:
        """Lead the course on after a cycle. It must not raise."""
        with self.lock:
            heard, now = time.perf_counter(), state.time.to_sec()
            gap, self._heard = heard - self._heard, heard
            passed, self.last = now - self.last, now
            self._late = self._late or gap > STALLED
            if self._late:
                self._late = self._arm.state.time.to_sec() - now > BEHIND
            course = self.course
            if course is None:
                return
            if not self._late and self._motion is not None:
                was = course.row(self.clock)
                self.clock += min(max(passed, 0.0), CYCLE)
                if course.row(self.clock) != was:
                    self._motion.set_reference(course.reference(self.clock))
            row = Row(state, course.target(self.clock))
            self.log.append(row)
            self._rows.append(row)
