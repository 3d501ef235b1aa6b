"""Contact reflex of the simulated arm: a 1 kHz momentum observer, and the reaction to a contact.

It uses only signals that a real arm has at every cycle: encoders, measured joint torques, and the nominal
model as of the beginning of a run of cycles. It tests the wrench at the TCP. It also tests the part of the
joint torques that no force at the hand explains, which shows contact of a link.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from palpate.common.pose import Array
from palpate.robots.nominal import RIDGE, explain_torque, force_of
from palpate.robots.sheet import Reflex
from palpate.robots.simulated.timing import BLOCK, LONGEST_RUN, TIMESTEP
from palpate.robots.springs import SpringGains

# s: time constant of the observer. Franka states that its arms detect a collision within 2 ms
# (Panda datasheet, "collision detection time").
OBSERVER_TIME = 0.005
# 1/s: rate at which the arm slows down after it has stopped itself, within its joints' torques. A
# motion of 0.25 m/s ends after 2 mm. A heavy arm is in contact with a rigid post for about 10 ms.
# The post should not have to absorb the momentum that the arm can brake in this time.
BRAKING = 150.0
# s: time constant with which the reversed speed of an empty arm decays after it has stopped itself. A bar in the way
# of a link acts as a wedge with ten times the link's mass: an arm that only brakes presses on it for 100 ms. The arm
# goes back by 5 mm at most, on the path that it came.
BACKING = 0.02
# N: change of the force that counts as noticed; s: time constant of the average that it is compared
# with. A slow contact that adds 36 N/s (12 mm/s on springs of 3000 N/m) is noticed after 0.1 s, at
# 3.5 N.
FELT, USUAL_TIME = 3.0, 0.3

_KEEP = math.exp(-TIMESTEP / OBSERVER_TIME)
_BLEND = 1.0 - _KEEP
_FADE = math.exp(-TIMESTEP / BACKING)
# Weights of the observer's filter after each cycle: of its previous state (cycles, 1), and of each input.
_CYCLES: Array = np.arange(LONGEST_RUN * BLOCK, dtype=float)
_TORQUE_KEPT: Array = _KEEP ** (_CYCLES[:, None] + 1.0)
_INPUT_KEPT: Array = np.tril(_KEEP ** np.maximum(np.subtract.outer(_CYCLES, _CYCLES), 0))


@dataclass(slots=True, eq=False)
class Reaction:
    """Reaction of the arm to its own collision stop: it yields, and goes back with an empty hand."""

    inertia: Array  # (7, 7) kg m^2
    load: Array  # (7,) N m that hold the load on the hand
    most: Array  # (7,) N m, torque limits of the joints
    back: Array  # (7,) rad/s, speed of the joints on the way back; it decays with `BACKING`

    @property
    def gains(self) -> SpringGains:
        """Gains of the drives, which then take torques."""
        return SpringGains.of_torques(self.inertia)

    def torque(self, dq: Array) -> Array:
        """Compute the torques (7,), N m, of the next cycle at joint rates `dq` (7,), rad/s.

        Dampers proportional to the inertia slow all joints down at one rate, and no joint pushes another against the
        obstacle. All torques are scaled down together where a joint would exceed its limit.
        """
        braking = BRAKING * self.inertia @ (dq - self.back)
        self.back = _FADE * self.back
        share = max(1.0, float((np.abs(braking) / self.most).max()))
        return self.load - braking / share


class Guard:
    """Observer of the external joint torques in the control loop; it reports the cycle of a contact.

    Within a run of at most 40 ms, inertia and Jacobian are those of its beginning. The arm turns by less than
    0.04 rad in that time.
    """

    def __init__(self, joints: int) -> None:
        self._torque: Array = np.zeros(joints)
        self._dq: Array = np.zeros(joints)
        self._start: Array = np.zeros(joints)
        self._force: Array = np.zeros(3)
        self._usual: Array = np.zeros(3)
        self._usual_torque: Array = np.zeros(joints)
        self._look = 0
        self.yielding = False  # True while the arm yields
        # Number of cycles after which the last run ends because the force changed; None without
        # such a change.
        self.felt: int | None = None
        # Reason for which the arm stopped itself in the last run; None while it continues.
        self.fired: str | None = None

    def begin(
        self,
        thresholds: Reflex | None,
        reaction: Callable[[Array], Reaction],
        jacobian: Array,
        mass_matrix: Array,
        dampers: Array,
        dq: Array,
        deviation: Array,
        tick: int,
    ) -> None:
        """Prepare a run of cycles.

        Args:
            thresholds: limits of the external wrench; None while the arm yields.
            reaction: makes the reaction to an exceeded threshold, with the joints' speed on the way back.
            jacobian: (6, 7), world axes about the TCP.
            mass_matrix: (7, 7) kg m^2 that the commanded torques move.
            dampers: (7, 7) N m s/rad, of the controller.
            dq: (7,) rad/s now.
            deviation: (n, 7) N m of each cycle: sensed less commanded torques, and less Coriolis and
                centrifugal torques.
            tick: cycles per tick; a change of the force may end the run at a multiple of it.
        """
        from scipy.linalg.lapack import dposv  # not for a plan that nothing executes

        # Maps from joint torques to the wrench, (J J^T)^-1 J, and to the torques that no force at the TCP
        # explains.
        self._to_wrench = dposv(jacobian @ jacobian.T + RIDGE, jacobian)[1].T
        self._jacobian, self._mass_matrix, self._dampers = jacobian, mass_matrix, dampers
        self._to_force = force_of(jacobian)
        self._to_rest = np.eye(len(dq)) - self._to_force.T @ jacobian[:3]
        self._known = deviation
        # Speed a run ago: at the end of this run, a hard contact has reversed some joints.
        self._came, self._start, self._dq = self._start, dq, dq
        # Usual force and torques are low-pass filters of those at the end of each run.
        kept = math.exp(-self._look * TIMESTEP / USUAL_TIME)
        self._usual = self._force + kept * (self._usual - self._force)
        self._usual_torque = self._torque + kept * (self._usual_torque - self._torque)
        self._tick, self.felt = tick, None
        self._thresholds = thresholds or Reflex(math.inf, math.inf)
        self._look, self._reaction = 0, reaction
        self.yielding, self.fired = thresholds is None, None
        if self.yielding:
            self.reaction = reaction(self.reaction.back)

    def observe(self, torque: Array, dq: Array, step: float) -> int | None:
        """Return the first of the next n cycles whose wrench exceeds the thresholds; None if there is none.

        After that cycle the observer stops: the arm yields. `torque` (n, 7) is commanded at the joints, N m,
        less the nominal arm's gravity compensation. `dq` (n, 7), rad/s, is at the end of each cycle; `step`,
        s, is that of the physics.
        """
        # Change of the momentum in each cycle. The integrator is implicit in the dampers, which adds h D to M.
        count = len(dq)
        gained = dq.copy()
        gained[0] -= self._dq
        gained[1:] -= dq[:-1]
        momentum = gained @ (self._mass_matrix + step * self._dampers)
        # External torque per cycle, and its first-order filter with the state before.
        new = torque - momentum / TIMESTEP + self._known[self._look : self._look + count]
        torques = _INPUT_KEPT[:count, :count] @ (_BLEND * new) + _TORQUE_KEPT[:count] * self._torque
        self._look += count
        self._torque, self._dq = torques[-1], dq[-1]
        # Test the doubtful cycles in full, and stop at the first one beyond a threshold.
        wrenches = torques @ self._to_wrench
        for i in self._doubtful(torques, wrenches):
            self.fired = self._reason(torques[i])
            if self.fired is not None:
                # Only an empty hand in free air goes back: a load would be shaken.
                links = self._thresholds.links
                goes_back = links is not None and math.isfinite(links.change)
                self.reaction = self._reaction(-float(goes_back) * self._came)
                self._torque, self.yielding = torques[i], True
                return i
        self._feel(torques, wrenches[:, :3], dq)
        return None

    def _feel(self, torques: Array, forces: Array, dq: Array) -> None:
        """Compare the forces of some cycles with the usual force. Where one differs, end the run with that
        tick.
        """
        # Find the first cycle whose force differs, and round up to whole ticks.
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
        if (links := self._thresholds.links) is not None:
            large |= squares(torques @ self._to_rest) > links.torque**2
            large |= squares(torques - self._usual_torque) > links.change**2
        return large.nonzero()[0].tolist() if large.any() else []

    def _reason(self, torque: Array) -> str | None:
        """Return the reason to stop at external joint torques (7,), N m; None without one."""
        reason, links = self._thresholds.fired(torque @ self._to_wrench), self._thresholds.links
        if reason is not None or links is None:
            return reason
        jump = torque - self._usual_torque
        return links.stop_reason(*explain_torque(self._jacobian, torque), math.sqrt(jump @ jump))


def squares(rows: Array) -> Array:
    """Compute the sums of squares (n,) of rows (n, m)."""
    return np.add.reduce(rows * rows, axis=1)
