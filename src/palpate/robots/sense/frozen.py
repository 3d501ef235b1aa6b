"""Signals that have stopped changing though their stamps go on.

What a sensor says of an arm that moves differs in the last bit from sample to sample; what a noisy
sensor says differs always. Whether it is noisy is learnt from the signal itself: a perfect one may
rest.
"""

from __future__ import annotations

from collections.abc import Mapping

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
ENCODERS = "encoders"
"""The signal that no force makes."""

Mask = NDArray[np.bool_]


class Constancy:
    """Since when each column of some signals, side by side, has been the same.

    Attributes:
        names: of the signals.
    """

    def __init__(self, widths: Mapping[str, int]) -> None:
        """Signals by name, with so many columns each, in this order."""
        ends = np.cumsum(list(widths.values())).tolist()
        self._columns = {
            name: slice(end - width, end)
            for (name, width), end in zip(widths.items(), ends, strict=True)
        }
        self.names = tuple(widths)
        self._since = np.zeros(ends[-1])
        self._changes = np.zeros((LEARNT, ends[-1]))
        self._goes_on = np.ones(ends[-1], dtype=np.bool_)
        """(n,) columns that changed with the last row."""
        self._row = 0
        self._last: Array | None = None
        self._marks: dict[str, tuple[Array, Array]] = {}
        """Joints and equilibrium when a signal changed last."""

    def follow(self, t: Array, values: Array, q: Array, target: Array) -> None:
        """Take the signals' next `values` (m, n) at times `t` (m,), with the joints at `q` (m, 7)
        and the equilibrium commanded to `target` (m, 7)."""
        if self._last is None:
            self._last = values[:1]
            self._since[:] = t[0]
            self._marks = dict.fromkeys(self.names, (q[0], target[0]))
        for first in range(0, len(t), LEARNT):
            rows = slice(first, first + LEARNT)
            self._take(t[rows], values[rows], q[rows], target[rows])

    def stands(self, t: float) -> bool:
        """Test if any column has been constant for so long that it may be frozen."""
        return t - float(self._since.min()) >= FROZEN

    def since(self, name: str) -> Array:
        """(n,) s, robot time, since when each column of a signal has been the same."""
        return self._since[self._columns[name]]

    def noisy(self, name: str) -> Mask:
        """(n,) columns of a signal that never rested before they stood."""
        return np.quantile(self._changes[:, self._columns[name]], 0.1, axis=0) > NOISY

    def moved(self, name: str) -> float:
        """Rad that a joint has turned since the signal changed."""
        return float(np.abs(self._q - self._marks[name][0]).max())

    def led(self, name: str) -> float:
        """m that the commanded equilibrium has moved, or turned, since the signal changed."""
        way = np.abs(self._target - self._marks[name][1])
        return max(float(way[:3].max()), 0.1 * float(way[3:].max()))

    def _take(self, t: Array, values: Array, q: Array, target: Array) -> None:
        """At most `LEARNT` rows."""
        assert self._last is not None
        before = np.concatenate([self._last, values[:-1]])
        changed, steps = values != before, np.abs(values - before)
        into = (self._row + np.arange(len(t))) % LEARNT
        self._last, self._q, self._target = values[-1:], q[-1], target[-1]
        self._row += len(t)
        if changed.all() and self._goes_on.all():
            self._changes[into] = steps
            self._since[:] = t[-1]
            self._marks = dict.fromkeys(self.names, (q[-1], target[-1]))
            return
        self._learn(changed, steps, into)
        latest = _latest(changed)
        went_on = latest >= 0
        self._since[went_on] = t[latest[went_on]]
        for name, columns in self._columns.items():
            row = int(latest[columns].max())
            if row >= 0:
                self._marks[name] = q[row], target[row]

    def _learn(self, changed: Mask, steps: Array, into: NDArray[np.intp]) -> None:
        """A column that stands keeps what its noise was; one that goes on after it stood may
        rest, and is learnt anew."""
        gone_on = np.concatenate([self._goes_on[None], changed[:-1]])
        anew = _latest(changed & ~gone_on)
        self._changes[:, anew >= 0] = 0.0
        known = changed & (np.arange(len(changed))[:, None] >= anew)
        self._changes[into] = np.where(known, steps, self._changes[into])
        self._goes_on = changed[-1]


def frozen(signals: Constancy, t: float) -> Fault | None:
    """The first signal that is frozen; the one called `encoders` is what its name says, all others
    are made by forces."""
    if not signals.stands(t):
        return None
    found = frozen_encoders(signals, t)
    for name in signals.names:
        if name != ENCODERS:
            found = found or frozen_torques(name, signals, t)
    return found


def frozen_torques(name: str, signals: Constancy, t: float) -> Fault | None:
    """A signal that forces make: it changes with the arm's posture, or by its noise."""
    since = signals.since(name)
    lasted, moved = t - since, signals.moved(name)
    if lasted.min() >= FROZEN and moved > MOVED:
        why = f"while a joint turned by {1e3 * moved:.1f} mrad"
        return _fault(name, t, float(since.max()), why)
    stands = lasted >= FROZEN
    if not stands.any():
        return None
    stands &= signals.noisy(name)
    if not stands.any():
        return None
    columns = ", ".join(str(i + 1) for i in np.flatnonzero(stands))
    why = f"in column {columns}, whose noise let it never rest before"
    return _fault(name, t, float(since[stands].min()), why)


def frozen_encoders(signals: Constancy, t: float) -> Fault | None:
    """Joint positions: they change when the arm is led on, even if something holds it."""
    since, led = signals.since(ENCODERS), signals.led(ENCODERS)
    if (t - since).min() < FROZEN or led < LED:
        return None
    why = f"while the arm was led on by {1e3 * led:.1f} mm"
    return _fault(ENCODERS, t, float(since.max()), why)


def _fault(name: str, t: float, since: float, why: str) -> Fault:
    return Fault(f"frozen {name}", f"the same to the last bit for {t - since:.2f} s {why}", since)


def _latest(changed: Mask) -> NDArray[np.intp]:
    """(n,) the last row in which each column of `changed` (m, n) did; -1 for none."""
    rows = np.arange(len(changed))[:, None]
    return np.where(changed, rows, -1).max(axis=0)
