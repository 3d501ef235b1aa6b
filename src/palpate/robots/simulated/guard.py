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
from palpate.robots.simulated.timing import TIMESTEP

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


class Reaction(NamedTuple):
    """What the arm does when it stops itself: it gives way.

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
    """Follows the external wrench while the control loop runs, and says when it is too much.

    Within a run of at most 40 ms inertia and Jacobian are those of its beginning; what the arm
    turns meanwhile is below 0.04 rad.
    """

    def __init__(self) -> None:
        self._wrench, self._dq = np.zeros(6), np.zeros(7)
        self._input = np.zeros(14)
        self._torque, self._gained = self._input[:7], self._input[7:]
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
        to_momentum = to_wrench @ inertia / TIMESTEP
        self._to_wrench = np.concatenate([to_wrench, -to_momentum], axis=1)
        self._known = deviation @ to_wrench.T
        self._dq[:] = dq
        self._thresholds = thresholds or _ANYTHING
        self._little = self._thresholds.least**2
        self._look, self._reaction = 0, reaction
        self.yielding, self.fired = thresholds is None, None
        if self.yielding:
            self.reaction = reaction()

    def feels(self, commanded: Array, weight: Array, dq: Array) -> bool:
        """A cycle later: whether it is too much, and the arm gives way from now on.

        `commanded` (7,) N m at the joints, of which `weight` holds the nominal arm up.
        """
        wrench = self._wrench
        np.subtract(commanded, weight, out=self._torque)
        np.subtract(dq, self._dq, out=self._gained)
        self._dq[:] = dq
        wrench *= _KEEP
        wrench += self._to_wrench.dot(self._input)
        wrench += self._known[self._look]
        self._look += 1
        if wrench.dot(wrench) <= self._little:
            return False
        self.fired = self._thresholds.fired(wrench)
        if self.fired is None:
            return False
        self.yielding, self.reaction = True, self._reaction()
        return True
