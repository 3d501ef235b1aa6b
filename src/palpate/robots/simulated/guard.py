"""Contact reflex of the simulated arm: a 1 kHz momentum observer, and the reaction to a contact.

It uses only what a real arm has at every cycle: encoders, measured joint torques, and the nominal
model as of the beginning of a run of cycles. Besides the wrench at the TCP it tests the part of the joints'
torques that no force at the hand explains: contact of a link.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from palpate.common.pose import Array
from palpate.robots.nominal import RIDGE, explain_torque, force_of
from palpate.robots.sheet import Reflex
from palpate.robots.simulated.actuators import SpringGains
from palpate.robots.simulated.timing import BLOCK, LONGEST_RUN, TIMESTEP

OBSERVER_TIME = 0.005
"""s: time constant of the observer; Franka states that its arms detect a collision within 2 ms
(Panda datasheet, "collision detection time")."""
BRAKING = 150.0
"""1/s: rate at which the arm slows down when it has stopped itself, within its joints' torques;
0.25 m/s end after 2 mm. A heavy arm is in contact with a rigid post for some 10 ms: the post should
not have to take the momentum that the arm can brake in them."""
FELT, USUAL_TIME = 3.0, 0.3
"""N by which a force differs when something is felt, and s over which that of the time before is averaged:
a slow contact that adds 36 N/s (12 mm/s on springs of 3000 N/m) is felt after 0.1 s, at 3.5 N."""

_KEEP = math.exp(-TIMESTEP / OBSERVER_TIME)
_BLEND = 1.0 - _KEEP
# Weights of the observer's filter after each cycle: of its torques (cycles, 1), and of each input.
_CYCLES: Array = np.arange(LONGEST_RUN * BLOCK, dtype=float)
_TORQUE_KEPT: Array = _KEEP ** (_CYCLES[:, None] + 1.0)
_INPUT_KEPT: Array = np.tril(_KEEP ** np.maximum(np.subtract.outer(_CYCLES, _CYCLES), 0))


class Reaction(NamedTuple):
    """Reaction of the arm to its own collision stop: it yields."""

    gains: SpringGains  # of the drives, which then take torques
    damping: Array  # (7, 7) N m s/rad
    load: Array  # (7,) N m that hold the load on the hand
    most: Array  # (7,) N m, torque limits of the joints

    @classmethod
    def of(cls, inertia: Array, load: Array, most: Array) -> Reaction:
        """Make dampers proportional to the inertia (7, 7): the whole arm slows down as one, and no
        joint pushes another against what has stopped the TCP."""
        return cls(SpringGains.of_torques(inertia), BRAKING * inertia, load, most)

    def torque(self, dq: Array) -> Array:
        """Compute the torques (7,), N m, at joint rates `dq` (7,), rad/s, all scaled down where one
        joint would exceed its limit."""
        braking = self.damping @ dq
        share = max(1.0, float((np.abs(braking) / self.most).max()))
        return self.load - braking / share


class Guard:
    """Observer of the external joint torques in the control loop; it reports the cycle of a contact.

    Within a run of at most 40 ms inertia and Jacobian are those of its beginning; the arm turns by
    less than 0.04 rad in it.

    Attributes:
        yielding: True while the arm yields.
        fired: reason that the arm stopped itself in the last run; None while it goes on.
        felt: cycles after which the last run ends, or would have, because the force differs from that of
            the time before; None while it does not.
    """

    def __init__(self) -> None:
        self._torque: Array = np.zeros(7)
        self._dq: Array = np.zeros(7)
        self._force: Array = np.zeros(3)
        self._usual: Array = np.zeros(3)
        self._look = 0
        self.yielding = False
        self.felt: int | None = None
        self.fired: str | None = None

    def begin(
        self,
        thresholds: Reflex | None,
        reaction: Callable[[], Reaction],
        jacobian: Array,
        mass_matrix: Array,
        dampers: Array,
        dq: Array,
        deviation: Array,
        tick: int,
    ) -> None:
        """Prepare a run of cycles.

        Args:
            thresholds: of the external wrench; None while the arm yields.
            reaction: makes the reaction above them.
            jacobian: (6, 7), world axes about the TCP.
            mass_matrix: (7, 7) kg m^2 that the commanded torques move.
            dampers: (7, 7) N m s/rad, of the controller.
            dq: (7,) rad/s now.
            deviation: (n, 7) N m of each cycle: sensed less commanded torques, and less Coriolis and
                centrifugal torques.
            tick: cycles with multiples of which the run may end because something is felt.
        """
        from scipy.linalg.lapack import dposv  # not for a plan that nothing executes

        self._to_wrench = dposv(jacobian @ jacobian.T + RIDGE, jacobian)[1].T
        self._jacobian, self._mass_matrix, self._dampers = jacobian, mass_matrix, dampers
        self._to_rest = np.eye(7) - force_of(jacobian).T @ jacobian[:3]
        self._known = deviation
        self._dq = dq
        kept = math.exp(-self._look * TIMESTEP / USUAL_TIME)
        self._usual = self._force + kept * (self._usual - self._force)
        self._tick, self.felt = tick, None
        self._thresholds = thresholds or Reflex(math.inf, math.inf)
        self._look, self._reaction = 0, reaction
        self.yielding, self.fired = thresholds is None, None
        if self.yielding:
            self.reaction = reaction()

    def observe(self, torque: Array, dq: Array, step: float) -> int | None:
        """Return the first of the next n cycles whose wrench exceeds the thresholds; None if none.

        After it the wrench is followed no further: the arm yields.

        Args:
            torque: (n, 7) N m commanded at the joints, less the nominal arm's gravity compensation.
            dq: (n, 7) rad/s at the end of each cycle.
            step: s, of the physics.
        """
        count = len(dq)
        gained = dq.copy()
        gained[0] -= self._dq
        gained[1:] -= dq[:-1]
        momentum = gained @ (self._mass_matrix + step * self._dampers)
        new = torque - momentum / TIMESTEP + self._known[self._look : self._look + count]
        torques = _INPUT_KEPT[:count, :count] @ (_BLEND * new) + _TORQUE_KEPT[:count] * self._torque
        self._look += count
        self._torque, self._dq = torques[-1], dq[-1]
        wrenches = torques @ self._to_wrench
        for i in self._doubtful(torques, wrenches):
            self.fired = self._reason(torques[i])
            if self.fired is not None:
                self._torque, self.yielding, self.reaction = torques[i], True, self._reaction()
                return i
        self._feel(torques, wrenches[:, :3], dq)
        return None

    def _feel(self, torques: Array, forces: Array, dq: Array) -> None:
        """Compare the forces of some cycles with that of the time before; where one differs, the cycles after
        that tick are left out."""
        first = self._look - len(dq)
        differs = squares(forces - self._usual) > FELT**2
        if self.felt is None and differs.any():
            self.felt = ((first + int(differs.argmax())) // self._tick + 1) * self._tick
        if self.felt is not None:
            self._look = min(self._look, self.felt)
        last = self._look - first - 1
        self._torque, self._dq, self._force = torques[last], dq[last], forces[last]

    def _doubtful(self, torques: Array, wrenches: Array) -> list[int]:
        """List the cycles, of `torques` (n, 7), in which a threshold may be exceeded."""
        # Only wrenches larger than the smallest threshold need the full test.
        large = squares(wrenches) > self._thresholds.least**2
        if self._thresholds.links is not None:
            large |= squares(torques @ self._to_rest) > self._thresholds.links.torque**2
        return large.nonzero()[0].tolist() if large.any() else []

    def _reason(self, torque: Array) -> str | None:
        """Return the reason to stop at external joint torques (7,), N m; None while it goes on."""
        reason, links = self._thresholds.fired(torque @ self._to_wrench), self._thresholds.links
        if reason is not None or links is None:
            return reason
        return links.stop_reason(*explain_torque(self._jacobian, torque))


def squares(rows: Array) -> Array:
    """Compute the sums of squares (n,) of rows (n, m)."""
    return np.add.reduce(rows * rows, axis=1)
