"""Collision reflex: contact thresholds at which the robot stops itself."""

from __future__ import annotations

import math
from dataclasses import dataclass

from palpate.geometry.pose import Array


@dataclass(frozen=True, slots=True)
class Reflex:
    """Thresholds of the external wrench, without the carried load, at which the arm stops itself.

    Attributes:
        force: N, magnitude at the TCP.
        torque: N m, likewise.
        load: N that may hang on the hand besides: a weight, which pulls straight down.
        sideways: N, of the horizontal force alone.
    """

    force: float
    torque: float
    load: float = 0.0
    sideways: float = math.inf

    @property
    def least(self) -> float:
        """No smaller wrench, N or N m, is too much."""
        return min(self.force, self.torque, self.sideways)

    def fired(self, contact: Array) -> str | None:
        """Return the reason to stop at the external wrench `contact` (6,), the convention of
        `palpate.trace`; None while it goes on."""
        x, y, z, turn_x, turn_y, turn_z = contact.tolist()
        force = math.hypot(x, y, z - min(max(z, 0.0), self.load))
        if force > self.force:
            return _worded(f"{force:.1f} N", f"{self.force:g} N")
        sideways = math.hypot(x, y)
        if sideways > self.sideways:
            return _worded(f"{sideways:.1f} N sideways", f"{self.sideways:.0f} N")
        torque = math.hypot(turn_x, turn_y, turn_z)
        if torque > self.torque:
            return _worded(f"{torque:.1f} N m", f"{self.torque:g} N m")
        return None


def _worded(felt: str, allowed: str) -> str:
    return f"unexpected contact: the arm stopped itself at {felt}, more than {allowed}"


@dataclass(frozen=True, slots=True)
class Reflexes:
    """An arm's thresholds for what it does.

    Attributes:
        free: in free air with empty fingers.
        carrying: with an object between them.
        probing: in a guarded motion towards something.
        contact: touching is the purpose.
    """

    free: Reflex
    carrying: Reflex
    probing: Reflex
    contact: Reflex
