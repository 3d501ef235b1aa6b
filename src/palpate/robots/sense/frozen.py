"""Signals that have stopped changing though their stamps go on.

What a sensor says of an arm that moves differs in the last bit from sample to sample; what a noisy
sensor says differs always. Whether it is noisy is learnt from the signal itself: a perfect one may
rest.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.geometry.pose import Array
from palpate.robots.sense.fault import Fault

FROZEN = 0.1
"""s that a signal stays the same to the last bit, before it is called frozen."""
MOVED = 2e-4
"""rad: an arm that has turned a joint by it feels something else than before, be it the last
bit."""
LED = 1e-3
"""m of the commanded equilibrium, a tenth of a quaternion's change counting as much: the encoders
of an arm that is led on by it see it."""
NOISY = 1e-3
"""N m (N) by which a signal changes from sample to sample, nine times out of ten: one with so much
noise never repeats itself. Torque sensors have some 20 times as much in 5 ms."""
LEARNT = 100
"""Changes in a row from which the noise is known."""


class Constancy:
    """Since when each column of a signal has been the same.

    Attributes:
        since: (n,) s, robot time.
        moved: rad that a joint has turned since a column changed last. led: m that the commanded
            equilibrium has moved, or turned, since then.
    """

    def __init__(self) -> None:
        self._last: Array | None = None
        self.moved = self.led = 0.0

    def follow(self, t: float, value: Array, q: Array, target: Array) -> None:
        """Take the signal's `value` (n,) at `t`, with the joints at `q` (7,) and the equilibrium
        commanded to `target` (7,)."""
        if self._last is None:
            self._last, self.since, self._t = value, np.full(len(value), t), t
            self._changes = np.zeros((LEARNT, len(value)))
            self._row = np.zeros(len(value), dtype=np.intp)
            self._q, self._target = q, target
            return
        same = value == self._last
        changed = np.flatnonzero(~same)
        # A column that stands keeps what its noise was; one that goes on after it stood may rest.
        self._changes[:, changed[self.since[changed] < self._t]] = 0.0
        self._t = t
        self._changes[self._row[changed], changed] = np.abs(value - self._last)[changed]
        self._row[changed] = (self._row[changed] + 1) % LEARNT
        self.since[changed] = t
        self._last = value
        if len(changed):
            self._q, self._target = q, target
        self.moved = float(np.abs(q - self._q).max())
        self.led = _way(self._target, target)

    def noisy(self) -> NDArray[np.bool_]:
        """(n,) columns that never rested before they stood."""
        return np.quantile(self._changes, 0.1, axis=0) > NOISY

    def lasted(self, t: float) -> Array:
        """(n,) s that each column has been the same."""
        return t - self.since


def frozen_torques(name: str, signal: Constancy, t: float) -> Fault | None:
    """A signal that forces make: it changes with the arm's posture, or by its noise."""
    if signal.lasted(t).min() >= FROZEN and signal.moved > MOVED:
        why = f"while a joint turned by {1e3 * signal.moved:.1f} mrad"
        return _fault(name, t, float(signal.since.max()), why)
    stands = signal.lasted(t) >= FROZEN
    if not stands.any():
        return None
    stands &= signal.noisy()
    if not stands.any():
        return None
    columns = ", ".join(str(i + 1) for i in np.flatnonzero(stands))
    why = f"in column {columns}, whose noise let it never rest before"
    return _fault(name, t, float(signal.since[stands].min()), why)


def frozen_encoders(signal: Constancy, t: float) -> Fault | None:
    """Joint positions: they change when the arm is led on, even if something holds it."""
    if signal.lasted(t).min() < FROZEN or signal.led < LED:
        return None
    why = f"while the arm was led on by {1e3 * signal.led:.1f} mm"
    return _fault("encoders", t, float(signal.since.max()), why)


def _fault(name: str, t: float, since: float, why: str) -> Fault:
    return Fault(f"frozen {name}", f"the same to the last bit for {t - since:.2f} s {why}", since)


def _way(before: Array, after: Array) -> float:
    moved = np.abs(after - before)
    return max(float(moved[:3].max()), 0.1 * float(moved[3:].max()))
