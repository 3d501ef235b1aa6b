"""Watcher of all of a robot's signals: keeps the first fault that it finds."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import numpy as np

from palpate.geometry.pose import Array
from palpate.robots.description import Limits, RobotDescription
from palpate.robots.robot import RobotState
from palpate.robots.sense.clock import Clock
from palpate.robots.sense.fault import Fault
from palpate.robots.sense.frozen import Constancy, frozen
from palpate.robots.sense.plausible import impossible, not_finite, pose_jumps, wrong_width
from palpate.robots.sense.spikes import Spikes
from palpate.trace.samples import Samples

DISAGREEMENT = 0.03
"""rad between the way of a joint and the integral of its speed, in `AGREED` s."""
AGREED = 0.1

EMPTY_FORCE, EMPTY_TORQUE = 10.0, 3.0
"""N, N m that an empty hand at rest at home may feel: 0.15 N of repeatability and 0.8 N of accuracy by
an arm's datasheet, the same again for what identification leaves of the links' masses, and what
friction behind the sensors holds after a motion. Where all joints hold 0.15 to 0.64 N m as identified
(Gaz et al., RA-L 2019, doi:10.1109/LRA.2019.2931248) the same way at its worst that is 3.9 N and 1.1 N m;
single robots may have twice the average."""
AT_HOME = 0.02
"""rad."""
SLOW = 0.01
"""rad/s."""
RESTED = 0.2
"""s at rest before it counts."""


class Watch:
    """Judges a robot's signals by themselves, and by the arm's description.

    Attributes:
        fault: the first one; nothing that the robot says later takes it back.
    """

    def __init__(self, limits: Limits, arm: RobotDescription) -> None:
        self.fault: Fault | None = None
        self._limits, self._arm = limits, arm
        self._clock, self._spikes = Clock(limits), Spikes(limits)
        self._before: RobotState | None = None
        self._felt: deque[Array] = deque()
        self._rested = 0.0
        self._states = Constancy({"wrench": 6, "contact": 6, "torques": 7, "encoders": 7})
        self._logged = Constancy({"wrench": 6, "torques": 7, "encoders": 7})
        self._last = Samples.empty()
        self._way = self._integral = np.zeros(7)
        self._summed = 0.0

    def asked(self, duration: float) -> None:
        """The robot is told to let `duration` s pass."""
        self._clock.ask(duration)

    def believable(self, state: RobotState) -> RobotState:
        """The state without what may be a spike."""
        return self._spikes.believable(state)

    def look(self, state: RobotState) -> None:
        """Take the state after an advance."""
        before, self._before = self._before, state
        self._find([self._clock.follow(state), self._spikes.follow(state)])
        if before is None:
            self._rested = state.t
        if before is None or state.t <= before.t:
            return
        self._find(
            [
                self._frozen(state),
                pose_jumps(state, before, self._limits),
                wrong_width(state, before, self._arm),
                self._empty(state),
            ]
        )

    def take(self, samples: Samples) -> None:
        """Take the samples that were logged since the last call."""
        if self._before is not None:
            self._find([self._clock.order(samples, self._before.t)])
        if not len(samples):
            return
        self._find([not_finite(samples)])
        if self.fault is None:
            jumps = impossible(samples, self._last, self._limits)
            self._find([jumps, self._stands(samples), self._disagree(samples)])
            self._last = samples

    def _find(self, faults: Iterable[Fault | None]) -> None:
        for fault in faults:
            self.fault = self.fault or fault

    def _frozen(self, state: RobotState) -> Fault | None:
        values = np.concatenate([state.wrench, state.contact, state.tau, state.q])
        target, t = state.target_world_tcp.vector, np.array([state.t])
        self._states.follow(t, values[None], state.q[None], target[None])
        return frozen(self._states, state.t)

    def _stands(self, samples: Samples) -> Fault | None:
        """Find frozen signals in the samples, as `_frozen` does in states."""
        values = np.concatenate([samples.wrench, samples.tau_ext, samples.q], axis=1)
        self._logged.follow(samples.t, values, samples.q, samples.target_world_tcp)
        return frozen(self._logged, float(samples.t[-1]))

    def _disagree(self, samples: Samples) -> Fault | None:
        """Encoders that go elsewhere than their speeds."""
        t = np.concatenate([self._last.t[-1:], samples.t])
        q = np.concatenate([self._last.q[-1:], samples.q])
        dt = t[1:] - t[:-1]
        self._way = self._way + (q[-1] - q[0])
        self._integral = self._integral + dt @ samples.dq[len(samples) - len(dt) :]
        self._summed += float(dt.sum())
        if self._summed < AGREED:
            return None
        apart, lasted = np.abs(self._way - self._integral), self._summed
        self._way = self._integral = np.zeros(7)
        self._summed = 0.0
        if apart.max() <= DISAGREEMENT:
            return None
        i, t = int(apart.argmax()), float(samples.t[-1])
        what = f"joint {i + 1} is {apart[i]:.3f} rad from where its speed led in {lasted:.2f} s"
        return Fault("speeds against encoders", what, t - lasted)

    def _empty(self, state: RobotState) -> Fault | None:
        """Check the wrench of an empty hand at rest at home, in free air."""
        if not self._at_home(state):
            self._felt.clear()
            self._rested = state.t
            return None
        self._felt.append(state.contact)
        if state.t - self._rested < RESTED:
            return None
        felt = np.median(np.array(self._felt), axis=0)
        self._felt.popleft()
        force, torque = float(np.linalg.norm(felt[:3])), float(np.linalg.norm(felt[3:]))
        if force <= EMPTY_FORCE and torque <= EMPTY_TORQUE:
            return None
        what = f"{force:.1f} N and {torque:.1f} N m at rest at home, with nothing in the hand"
        return Fault("a force out of nothing", what, self._rested)

    def _at_home(self, state: RobotState) -> bool:
        moves = state.moving or state.gripper_moving or state.gripping
        if moves or state.reflex or state.width < self._arm.hand.opening - 0.005:
            return False
        away = float(np.abs(state.q - self._arm.home).max())
        return away < AT_HOME and float(np.abs(state.dq).max()) < SLOW
