"""Forces that jump: held back until the next state says the same, and counted where it does not."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

import numpy as np

from palpate.geometry.pose import Array
from palpate.robots.description import Limits
from palpate.robots.robot import RobotState
from palpate.robots.sense.fault import Fault

FORCE, TORQUE = 4.0, 2.0
"""N, N m by which a contact may grow from one state to the next and be believed at once: at 20 mm/s
it grows by 1 N. A hard one grows by more, and is believed 20 ms late; the robot's own reflex is not.
What is pressed and rubbed may let go and hold again (stick-slip): as much as was felt within
`RUBBED` may come and go, too."""
RUBBED = 0.3
"""s in which the largest contact felt is forgotten (time constant); stick-slip comes back within 0.1 s."""
LOAD = 0.25
"""Of a joint's torque limit: the same for what it bears."""
MOST, WINDOW = 4, 1.0
"""So many spikes within so many s are a fault."""


class Spikes:
    """A median over three states, as far as it matters: what one state alone says is not
    believed."""

    def __init__(self, limits: Limits) -> None:
        self._scale = np.concatenate([np.full(3, FORCE), np.full(3, TORQUE), LOAD * limits.tau_max])
        self._believed: RobotState | None = None
        self._doubted: RobotState | None = None
        self._times: deque[float] = deque(maxlen=MOST)
        self._pressed, self._twisted = 0.0, 0.0  # N, N m: largest contact felt lately

    def follow(self, state: RobotState) -> Fault | None:
        """Take the next state."""
        self._forget(state.t)
        if self._doubted is not None and self._believed is not None:
            if self._apart(state, self._doubted) <= self._apart(state, self._believed):
                self._believed = state
            else:
                self._times.append(self._doubted.t)
        self._doubted = None
        if self._believed is None or self._apart(state, self._believed) <= 1.0:
            self._believed = state
        else:
            self._doubted = state
        return self._judged(state.t)

    def believable(self, state: RobotState) -> RobotState:
        """The state with the forces that are believed."""
        if self._doubted is None or self._believed is None:
            return state
        felt = self._believed
        return replace(
            state, tau=felt.tau, tau_ext=felt.tau_ext, wrench=felt.wrench, contact=felt.contact
        )

    def _judged(self, t: float) -> Fault | None:
        times = self._times
        if len(times) < MOST or t - times[0] > WINDOW:
            return None
        what = f"the forces jumped and came back {MOST} times within {t - times[0]:.2f} s"
        return Fault("spikes", what, times[0])

    def _forget(self, t: float) -> None:
        """The largest contact felt lately, once time `t` has come."""
        if self._believed is None:
            return
        left = math.exp(min(self._believed.t - t, 0.0) / RUBBED)
        contact = self._believed.contact
        self._pressed = max(_norm(contact[:3]), left * self._pressed)
        self._twisted = max(_norm(contact[3:]), left * self._twisted)

    def _apart(self, state: RobotState, other: RobotState) -> float:
        """Distance of two states' forces, in units of the change accepted without confirmation."""
        scale = self._scale.copy()
        scale[:3] = max(FORCE, self._pressed)
        scale[3:6] = max(TORQUE, self._twisted)
        return float(np.abs((_felt(state) - _felt(other)) / scale).max())


def _felt(state: RobotState) -> Array:
    """(13,) the contact's wrench, and what the joints bear."""
    return np.concatenate([state.contact, state.tau])


def _norm(v: Array) -> float:
    return math.sqrt(v @ v)
