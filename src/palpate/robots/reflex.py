"""Collision reflex: contact thresholds at which the robot stops itself."""

from __future__ import annotations

import math
from dataclasses import dataclass

from palpate.geometry.pose import Array


@dataclass(frozen=True, slots=True)
class Links:
    """Torques of the joints beyond which something has met a link, and not the hand or its load.

    A force f within `lever` of the TCP is a force at the TCP with a moment of at most `lever` |f|; what a
    force at the TCP alone does not explain (`palpate.robots.nominal.unexplained`) is that moment's, or
    friction's and the sensors'.
    """

    torque: float  # N m, norm over the joints, of their friction and of the sensors' errors
    lever: float  # m

    def met(self, unexplained: float, force: float) -> str | None:
        """Return the reason to stop at `unexplained` N m beside a `force`, N; None without one."""
        most = self.torque + self.lever * force
        if unexplained <= most:
            return None
        return (
            f"unexpected contact: a link met something: its joints bear {unexplained:.1f} N m that no "
            f"force on the hand explains, more than {most:.1f} N m"
        )


@dataclass(frozen=True, slots=True)
class Reflex:
    """Thresholds of the external wrench, without the carried load, at which the arm stops itself."""

    force: float  # N, magnitude at the TCP
    torque: float  # N m, likewise
    load: float = 0.0  # N of weight on the hand, straight down, allowed in addition
    sideways: float = math.inf  # N, of the horizontal force alone
    links: Links | None = None  # of contacts of the arm's links; None: not looked for
    pressed: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """N, world axes, on a hand that sets out from a contact, at rest there. The joints' friction keeps some of it
    on the way. What the hand meets then adds to the change as the contact ends, so that a force beyond `force`
    is that in itself and in its change."""

    @property
    def least(self) -> float:
        """The smallest threshold, N or N m."""
        return min(self.force, self.torque, self.sideways)

    def fired(self, contact: Array) -> str | None:
        """Return the reason to stop at the external wrench `contact` (6,), the convention of
        `palpate.trace`; None while it goes on."""
        x, y, z, turn_x, turn_y, turn_z = contact.tolist()
        force = math.hypot(x, y, z - min(max(z, 0.0), self.load))
        sideways, torque = math.hypot(x, y), math.hypot(turn_x, turn_y, turn_z)
        if force > self.force and math.dist((x, y, z), self.pressed) > self.force:
            excess = f"{force:.1f} N, more than {self.force:g} N"
        elif sideways > self.sideways:
            excess = f"{sideways:.1f} N sideways, more than {self.sideways:.0f} N"
        elif torque > self.torque:
            excess = f"{torque:.1f} N m, more than {self.torque:g} N m"
        else:
            return None
        return f"unexpected contact: the arm stopped itself at {excess}"


@dataclass(frozen=True, slots=True)
class Reflexes:
    """An arm's thresholds for each activity."""

    free: Reflex  # in free air with empty fingers
    carrying: Reflex  # with an object between them
    probing: Reflex  # in a guarded motion
    contact: Reflex  # for intended contact
