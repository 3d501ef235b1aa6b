"""The arm's control loop: franky's controllers at 1 kHz, led along a course cycle by cycle.

franky calls back after every cycle, in a thread of its own, from a queue. What is led is the loop's
latest state: while the queue is behind, as after a stall of this computer, states are logged and
nothing is led on.
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
from palpate.robots.franky.control.course import CYCLE, Course
from palpate.robots.franky.control.springs import BLENDING, TORQUE_STEP, Springs
from palpate.robots.franky.library import franky
from palpate.robots.reflex import Reflex
from palpate.robots.simulated.impedance import Inertia

STALLED = 0.003
"""s of wall time between two callbacks after which the queue may be behind."""
BEHIND = 0.003
"""s of robot time by which the queue's state is behind the loop's."""
KEPT = 5000
"""Cycles that the log keeps: what happened in the last 5 s."""
CLIPS = (np.full(3, 0.1), np.full(3, 0.5))
"""m, rad: no spring is stretched farther."""


class Row(NamedTuple):
    """Record of one cycle: franky's state and the equilibrium."""

    state: Any
    target: Array
    moving: bool


@dataclass(frozen=True, slots=True, eq=False)
class Reacted:
    """The arm stopped itself: the state in which it did, and under which thresholds."""

    state: Any
    thresholds: Reflex


class Drive:
    """Follows courses. All but the constructor may be called in any thread.

    Attributes:
        log: the last cycles.
        reacted: how the arm stopped itself since the last course was given; None while it did not.
    """

    def __init__(self, arm: Any, springs: Springs, pose_world_base: Pose) -> None:
        self._arm, self._springs = arm, springs
        self._up = pose_world_base.rotation[2]
        self.lock = threading.RLock()
        """Guards all that follows."""
        self.log: deque[Row] = deque(maxlen=KEPT)
        self.reacted: Reacted | None = None
        self._rows: list[Row] = []
        self._course: Course | None = None
        self._clock = self._last = 0.0
        self._heard = 0.0
        self._late = False
        self._motion: Any = None
        self._begun = False

    @property
    def begun(self) -> bool:
        """True if a control loop was started and has not been seen to end."""
        return self._begun

    @property
    def course(self) -> Course | None:
        """Current course; None before the first one, and after the arm stopped itself."""
        return self._course

    @property
    def clock(self) -> float:
        """s since the course was begun."""
        return self._clock

    @property
    def moving(self) -> bool:
        """True until the course has ended."""
        course = self._course
        return course is not None and course.row(self._clock) < course.last

    @property
    def last(self) -> float:
        """s, robot time of the newest cycle."""
        return self._last

    @property
    def heard(self) -> float:
        """`time.perf_counter` when the loop called back last."""
        return self._heard

    def take(self) -> list[Row]:
        """The cycles since the last call."""
        with self.lock:
            rows, self._rows = self._rows, []
        return rows

    def follow(
        self, make: Callable[[Course | None, float], Course], inertia: Inertia, reflex: Reflex
    ) -> None:
        """Take up the course that `make` makes of the present one and of how far it has come.

        Raises:
            Exception: whatever franky says against it.
        """
        with self.lock:
            before = self._course
            course = make(before, self._clock)
            self._course, self._clock, self.reacted = course, 0.0, None
            held = None if before is None else before.posture
            blends = held is None or course.posture is not held
            self._enter(inertia, reflex, blends)

    def guard(self, inertia: Inertia, reflex: Reflex) -> None:
        """Stop at other thresholds from now on."""
        with self.lock:
            if self._course is not None and self._begun:
                self._enter(inertia, reflex, blends=False)

    def ended(self) -> None:
        """Nobody follows any more: the loop has ended."""
        with self.lock:
            self._course, self._motion, self._begun = None, None, False

    def _enter(self, inertia: Inertia, reflex: Reflex, blends: bool) -> None:
        """Hand franky the controller that follows the course."""
        course = self._course
        assert course is not None
        motion = self._controller(course, inertia, blends)
        motion.set_reference(course.reference(self._clock))
        motion.register_callback(self._cycle)
        self._react(motion, reflex)
        self._motion = motion
        self._arm.move(motion, asynchronous=True)
        self._begun = True
        self._heard = time.perf_counter()

    def _controller(self, course: Course, inertia: Inertia, blends: bool) -> Any:
        module = franky()
        if course.posture is None:
            stiffness, damping = self._springs.of_joints(inertia)
            return module.JointImpedanceTrackingMotion(
                stiffness=stiffness,
                damping=damping,
                max_delta_tau=TORQUE_STEP,
                gains_time_constant=BLENDING,
            )
        stiffness, damping = self._springs.posture(inertia)
        share = 1e-3 if blends else 1.0
        motion = module.CartesianImpedanceTrackingMotion(
            translational_stiffness=self._springs.stiffness.translation,
            rotational_stiffness=self._springs.stiffness.rotation,
            posture_task=module.PostureTask(course.posture, share * stiffness, damping),
            translational_error_clip=CLIPS[0],
            rotational_error_clip=CLIPS[1],
            max_delta_tau=TORQUE_STEP,
            gains_time_constant=BLENDING,
        )
        motion.set_gains(self._springs.of_tcp(inertia))
        if blends:
            gains = motion.get_nullspace_gains()
            gains.posture_stiffness = stiffness
            motion.set_nullspace_gains(gains)
        return motion

    def _react(self, motion: Any, reflex: Reflex) -> None:
        """Stop within the next cycle once more is felt; see `Reflex.fired`. What franky's conditions
        cannot measure, torques, is left to the control box's own thresholds."""
        module = franky()
        f, up = module.Measure, self._up
        size = f.FORCE_X**2.0 + f.FORCE_Y**2.0 + f.FORCE_Z**2.0
        lift = f.FORCE_X * float(up[0]) + f.FORCE_Y * float(up[1]) + f.FORCE_Z * float(up[2])
        most, load = reflex.force**2, reflex.load
        beyond = size - 2.0 * load * lift + load**2
        too_much = (size > most) & (lift <= 0.0)
        too_much = too_much | ((beyond > most) & (lift > load))
        too_much = too_much | ((size - lift**2.0 > min(most, reflex.sideways**2)) & (lift > 0.0))
        if np.isfinite(reflex.sideways):
            too_much = too_much | (size - lift**2.0 > reflex.sideways**2)
        reaction = module.TorqueReaction(too_much, module.TorqueStopMotion())

        def reacted(state: Any, *_: Any) -> None:
            self._stopped_itself(Reacted(state, reflex))

        reaction.register_callback(reacted)
        motion.add_reaction(reaction)

    def _stopped_itself(self, how: Reacted) -> None:
        with self.lock:
            self.reacted = how
            self._course, self._motion = None, None

    def _cycle(self, state: Any, *_: Any) -> None:
        """After a cycle. Nothing may be raised here."""
        with self.lock:
            heard, now = time.perf_counter(), state.time.to_sec()
            gap, self._heard = heard - self._heard, heard
            passed, self._last = now - self._last, now
            self._late = self._late or gap > STALLED
            if self._late:
                self._late = self._arm.state.time.to_sec() - now > BEHIND
            course = self._course
            if course is not None and not self._late and self._motion is not None:
                was = course.row(self._clock)
                self._clock += min(max(passed, 0.0), CYCLE)
                if course.row(self._clock) != was:
                    self._motion.set_reference(course.reference(self._clock))
            if course is not None:
                row = Row(state, course.target(self._clock), self.moving)
                self.log.append(row)
                self._rows.append(row)
