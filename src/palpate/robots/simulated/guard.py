"""The 1 kHz reflex: a momentum observer in the control loop, and what it does when too much is felt.

Only what a real arm has at every cycle enters: encoders, measured joint torques, and the nominal
model as of the beginning of a run of cycles.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dposv

from palpate.geometry.pose import Array
from palpate.robots.nominal import RIDGE
from palpate.robots.reflex import Reflex
from palpate.robots.simulated.impedance import Gains
from palpate.robots.simulated.timing import BLOCK, LONGEST_RUN, TIMESTEP

OBSERVER_TIME = 0.005
"""s: time constant of the observer; Franka states that its arms detect a collision within 2 ms
(Panda datasheet, "collision detection time")."""
BRAKING = 150.0
"""1/s: how fast the arm slows down when it has stopped itself, within what its joints can exert;
0.25 m/s end after 2 mm. A heavy arm is in contact with a rigid post for some 10 ms: what it brakes
in these is not for the post to bear."""

_KEEP = math.exp(-TIMESTEP / OBSERVER_TIME)
_BLEND = 1.0 - _KEEP
_ANYTHING = Reflex(math.inf, math.inf)


def _faded(cycles: int) -> tuple[Array, Array]:
    """Weights of the observer's filter after each of some cycles: of its wrench (cycles, 1), and of
    each input (cycles, cycles)."""
    age = np.arange(cycles)[:, None] - np.arange(cycles)
    return _KEEP ** np.arange(1.0, cycles + 1)[:, None], np.tril(_KEEP ** np.maximum(age, 0))


_WRENCH_KEPT, _INPUT_KEPT = _faded(LONGEST_RUN * BLOCK)


class Reaction(NamedTuple):
    """Reaction of the arm to its own collision stop: it yields.

    Attributes:
        gains: of the drives, which then take torques.
        damping: (7, 7) N m s/rad.
        load: (7,) N m that hold what hangs on the hand.
        most: (7,) N m that the joints exert.
    """

    gains: Gains
    damping: Array
    load: Array
    most: Array

    @classmethod
    def of(cls, inertia: Array, load: Array, most: Array) -> Reaction:
        """Dampers like the inertia (7, 7): the whole arm slows down as one, and no joint pushes
        another against what has stopped the TCP."""
        return cls(Gains.of_torques(inertia), BRAKING * inertia, load, most)

    def torque(self, dq: Array) -> Array:
        """(7,) N m at joint rates (7,), rad/s; all less where one would need more than it has."""
        braking = self.damping @ dq
        share = max(1.0, float((np.abs(braking) / self.most).max()))
        return self.load - braking / share


class Guard:
    """Follows the external wrench through the cycles of the control loop, and says in which of them it
    is too much: the arm gives way from the next one on.

    Within a run of at most 40 ms inertia and Jacobian are those of its beginning; what the arm
    turns meanwhile is below 0.04 rad.
    """

    def __init__(self) -> None:
        self._wrench: Array = np.zeros(6)
        self._dq: Array = np.zeros(7)
        self.yielding = False
        """Whether the arm gives way now."""
        self.fired: str | None = None
        """Why the arm stopped itself in the last run; None while it goes on."""

    def begin(
        self,
        thresholds: Reflex | None,
        reaction: Callable[[], Reaction],
        jacobian: Array,
        inertia: Array,
        dq: Array,
        deviation: Array,
    ) -> None:
        """Before a run of cycles.

        Args:
            thresholds: what may be felt; None while the arm gives way.
            reaction: what the arm does where it is more.
            jacobian: (6, 7), world axes about the TCP.
            inertia: (7, 7) kg m^2 that the commanded torques move.
            dq: (7,) rad/s now.
            deviation: (n, 7) N m of each cycle: what the sensors show beyond what is commanded,
                less Coriolis and centrifugal torques.
        """
        to_wrench = _BLEND * dposv(jacobian @ jacobian.T + RIDGE, jacobian)[1]
        self._to_wrench, self._to_momentum = to_wrench.T, (to_wrench @ inertia / TIMESTEP).T
        self._known = deviation @ self._to_wrench
        self._dq = dq
        self._thresholds = thresholds or _ANYTHING
        self._little = self._thresholds.least**2
        self._look, self._reaction = 0, reaction
        self.yielding, self.fired = thresholds is None, None
        if self.yielding:
            self.reaction = reaction()

    def feels(self, torque: Array, dq: Array) -> int | None:
        """The first of the next n cycles in which too much was felt; None where there is none.

        After it the wrench is followed no further: the arm gives way.

        Args:
            torque: (n, 7) N m commanded at the joints, less what holds the nominal arm up.
            dq: (n, 7) rad/s at the end of each cycle.
        """
        count = len(dq)
        gained = dq.copy()
        gained[0] -= self._dq
        gained[1:] -= dq[:-1]
        new = torque @ self._to_wrench - gained @ self._to_momentum
        new += self._known[self._look : self._look + count]
        wrenches: Array = _INPUT_KEPT[:count, :count] @ new + _WRENCH_KEPT[:count] * self._wrench
        self._look += count
        self._wrench, self._dq = wrenches[-1], dq[-1]
        sizes = np.einsum("ij,ij->i", wrenches, wrenches)
        for i in np.flatnonzero(sizes > self._little).tolist():
            self.fired = self._thresholds.fired(wrenches[i])
            if self.fired is not None:
                self._wrench, self.yielding, self.reaction = wrenches[i], True, self._reaction()
                return i
        return None
