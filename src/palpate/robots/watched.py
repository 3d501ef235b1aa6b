"""A robot whose signals are checked for plausibility before any code acts on them."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from palpate.common.pose import Array
from palpate.robots.description import Limits, RobotDescription
from palpate.robots.robot import Robot, RobotState, RunsOn
from palpate.robots.signals import (
    Clock,
    Constancy,
    Fault,
    Spikes,
    frozen,
    impossible,
    not_finite,
    pose_jumps,
    wrong_width,
)
from palpate.trace.samples import Samples

# rad: largest difference between a joint's motion and the integral of its speed; s: time of the
# integral.
DISAGREEMENT, AGREED = 0.03, 0.1
# N, N m: largest wrench that an empty hand at rest at home may show. An arm's datasheet allows 0.15
# N of repeatability and 0.8 N of accuracy. Errors of the links' identified masses add the same, and
# static friction behind the sensors adds to it. If all joints hold the identified 0.15 to 0.64 N m
# (Gaz et al., RA-L 2019, doi:10.1109/LRA.2019.2931248) with the worst signs, they show 3.9 N and
# 1.1 N m. Single robots may have twice the average.
EMPTY_FORCE, EMPTY_TORQUE = 10.0, 3.0
AT_HOME = 0.02  # rad from home that counts as at home
SLOW = 0.01  # rad/s: slower joints count as at rest
RESTED = 0.2  # s at rest before it counts


class Watched:
    """A robot whose states report implausible signals and omit forces that only one state shows.

    `RobotState.fault` names the fault. The samples are the robot's own. Implements `Robot`.

    Signals are `sound` for a simulated robot without noise. They neither freeze nor get lost, and skipping
    these checks saves half of their time.
    """

    def __init__(self, robot: Robot, arm: RobotDescription, sound: bool = False) -> None:
        self._robot, self._sound = robot, sound
        self._runs_on = robot if isinstance(robot, RunsOn) else None
        self._watch = SignalWatch(robot.limits, arm, sound)
        self._advanced = True
        self._seen: RobotState | None = None
        self._shown: RobotState | None = None

    def __getattr__(self, name: str) -> Any:
        """Pass properties of the arm, and commands, unchanged."""
        return getattr(self._robot, name)

    @property
    def fault(self) -> Fault | None:
        """Fault of the signals; None while they are sound."""
        return self._watch.fault

    @property
    def state(self) -> RobotState:
        state = self._robot.state
        if self._shown is None or state is not self._seen:
            self._seen = state
            if self._advanced:
                self._advanced = False
                self._watch.look(state)
            shown, fault = self._watch.spikes.believable(state), self._watch.fault
            self._shown = (
                shown if fault is None else replace(shown, fault=shown.fault or str(fault))
            )
        return self._shown

    def advance(self, duration: float) -> None:
        self._robot.advance(duration)
        self._watch.clock.ask(duration)
        self._advanced, self._shown = True, None

    def run_on(self, ticks: int, tick: float) -> None:
        """Let time pass as `RunsOn`. Let one tick pass if the robot's own time passes, or a force is
        doubted.
        """
        if ticks <= 1 or self._runs_on is None or self._watch.spikes.doubting:
            self.advance(tick)
            return
        self._runs_on.run_on(ticks, tick)
        self._watch.clock.ask(ticks * tick)
        self._advanced, self._shown = True, None

    def drain(self) -> Samples:
        samples, known = self._robot.drain(), self._watch.fault
        if not self._sound:
            self._watch.take(samples)
        if self._watch.fault is not known:
            self._shown = None
        return samples


class SignalWatch:
    """All plausibility checks of a robot's signals, each alone and against the robot's description."""

    def __init__(self, limits: Limits, arm: RobotDescription, sound: bool = False) -> None:
        # The first fault; later reports of the robot do not clear it.
        self.fault: Fault | None = None
        self._sound = sound
        self._limits, self._arm = limits, arm
        self.clock, self.spikes = Clock(limits), Spikes(limits)
        self._before: RobotState | None = None
        self._contacts: deque[Array] = deque()
        self._rested = 0.0
        joints = len(arm.joints)
        own = {"torques": joints, "encoders": joints}
        self._states = Constancy({"wrench": 6, "contact": 6, **own})
        self._logged = Constancy({"wrench": 6, **own})
        self._last = Samples.empty(joints)
        self._way = self._integral = np.zeros(joints)
        self._summed = 0.0

    def look(self, state: RobotState) -> None:
        """Check the state after an advance."""
        before, self._before = self._before, state
        self._keep_first([self.clock.follow(state), self.spikes.follow(state)])
        if before is None:
            self._rested = state.t
        if before is None or state.t <= before.t:
            return
        self._keep_first(
            [
                None if self._sound else self._frozen(state),
                pose_jumps(state, before, self._limits),
                wrong_width(state, before, self._arm),
                self._empty_hand(state),
            ]
        )

    def _frozen(self, state: RobotState) -> Fault | None:
        values = np.concatenate([state.wrench, state.contact, state.tau, state.q])
        target, t = state.target_world_tcp.vector, np.array([state.t])
        self._states.follow(t, values[None], state.q[None], target[None])
        return frozen(self._states, state.t)

    def take(self, samples: Samples) -> None:
        """Check the samples that were logged since the last call."""
        if self._before is not None:
            self._keep_first([self.clock.order(samples, self._before.t)])
        if not len(samples):
            return
        self._keep_first([not_finite(samples)])
        if self.fault is not None:
            return
        values = np.concatenate([samples.wrench, samples.tau_ext, samples.q], axis=1)
        self._logged.follow(samples.t, values, samples.q, samples.target_world_tcp)
        jumps = impossible(samples, self._last, self._limits)
        stands = frozen(self._logged, float(samples.t[-1]))
        self._keep_first([jumps, stands, self._disagree(samples)])
        self._last = samples

    def _keep_first(self, faults: Iterable[Fault | None]) -> None:
        for fault in faults:
            self.fault = self.fault or fault

    def _disagree(self, samples: Samples) -> Fault | None:
        """Compare the encoders with the integral of their speeds."""
        # Motion and integral of the speed since the last comparison.
        t = np.concatenate([self._last.t[-1:], samples.t])
        q = np.concatenate([self._last.q[-1:], samples.q])
        dt = t[1:] - t[:-1]
        self._way = self._way + (q[-1] - q[0])
        self._integral = self._integral + dt @ samples.dq[len(samples) - len(dt) :]
        self._summed += float(dt.sum())
        if self._summed < AGREED:
            return None
        # Compare them after a while, and start the sums from zero.
        apart, lasted = np.abs(self._way - self._integral), self._summed
        self._way = self._integral = np.zeros_like(self._way)
        self._summed = 0.0
        if apart.max() <= DISAGREEMENT:
            return None
        i, t = int(apart.argmax()), float(samples.t[-1])
        what = f"joint {i + 1} is {apart[i]:.3f} rad from where its speed led in {lasted:.2f} s"
        return Fault("speeds against encoders", what, t - lasted)

    def _empty_hand(self, state: RobotState) -> Fault | None:
        """Check the wrench of an empty hand at rest at home, in free air."""
        # Any motion, grasp or distance from home starts the rest again.
        moves = state.moving or state.gripper_moving or state.gripping or state.reflex
        if (
            moves
            or state.width < self._arm.hand.opening - 0.005
            or float(np.abs(state.q - self._arm.home).max()) >= AT_HOME
            or float(np.abs(state.dq).max()) >= SLOW
        ):
            self._contacts.clear()
            self._rested = state.t
            return None
        # The median over the time at rest rejects single spikes.
        self._contacts.append(state.contact)
        if state.t - self._rested < RESTED:
            return None
        contact = np.median(np.array(self._contacts), axis=0)
        self._contacts.popleft()
        force, torque = float(np.linalg.norm(contact[:3])), float(np.linalg.norm(contact[3:]))
        if force <= EMPTY_FORCE and torque <= EMPTY_TORQUE:
            return None
        what = f"{force:.1f} N and {torque:.1f} N m at rest at home, with nothing in the hand"
        return Fault("a force out of nothing", what, self._rested)
