"""Signals that have stopped changing though their stamps go on.

A sensor of a moving arm differs in the last bit from sample to sample; a noisy sensor always does.
Its noise is learnt from the signal itself: a perfect one may rest.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from palpate.geometry.pose import Array
from palpate.robots.sense.signals import Fault

FROZEN = 0.1  # s that a signal stays the same to the last bit, before it is called frozen
REPEATS = 4  # in a row, likewise: a noisy signal in coarse steps repeats once now and then
MOVED = 2e-4  # rad of a joint's turn that changes every torque, be it in the last bit
LED = 1e-3
"""m of motion of the commanded equilibrium (0.1 of a quaternion's change counts as much) that the
encoders of the arm must show."""
NOISY = 1e-3
"""N m (N) of change from sample to sample, in nine of ten samples: a signal with so much noise never
repeats itself. Torque sensors have some 20 times as much in 5 ms."""
LEARNT = 100  # changes in a row from which the noise is known
ENCODERS = "encoders"  # the signal that forces do not cause

Mask = NDArray[np.bool_]


class Constancy:
    """Time since each column of some signals, side by side, has been the same.

    Attributes:
        names: of the signals.
    """

    def __init__(self, widths: Mapping[str, int]) -> None:
        """`widths`: signals by name, with their number of columns, in order."""
        ends = np.cumsum(list(widths.values())).tolist()
        self._columns = {
            name: slice(end - width, end)
            for (name, width), end in zip(widths.items(), ends, strict=True)
        }
        self.names = tuple(widths)
        self._since, self._repeats = np.zeros(ends[-1]), np.zeros(ends[-1], dtype=np.intp)
        self._changes = np.zeros((LEARNT, ends[-1]))
        self._goes_on = np.ones(ends[-1], dtype=np.bool_)  # columns that changed with the last row
        self._goes_on_all = True
        self._row = 0
        self._last: Array | None = None
        # Joints and equilibrium at each signal's last change.
        self._marks: dict[str, tuple[Array, Array]] = {}

    def follow(self, t: Array, values: Array, q: Array, target: Array) -> None:
        """Process the next `values` (m, n) of the signals at times `t` (m,), with joints `q` (m, 7)
        and commanded equilibrium `target` (m, 7)."""
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

    def lasted(self, name: str, t: float) -> Array:
        """Return the time (n,), s, for which each column of a signal has been the same; 0 before enough
        repeats."""
        columns = self._columns[name]
        return np.where(self._repeats[columns] < REPEATS, 0.0, t - self._since[columns])

    def since(self, name: str) -> Array:
        """Return the robot time (n,), s, since which each column of a signal has been the same."""
        return self._since[self._columns[name]]

    def noisy(self, name: str) -> Mask:
        """Select the columns of a signal that never rested before they stood."""
        return np.quantile(self._changes[:, self._columns[name]], 0.1, axis=0) > NOISY

    def moved(self, name: str) -> float:
        """Return the largest turn of a joint, rad, since the signal changed."""
        return float(np.abs(self._q - self._marks[name][0]).max())

    def led(self, name: str) -> float:
        """Return the motion of the commanded equilibrium, m, since the signal changed."""
        way = np.abs(self._target - self._marks[name][1])
        return max(float(way[:3].max()), 0.1 * float(way[3:].max()))

    def _take(self, t: Array, values: Array, q: Array, target: Array) -> None:
        """Process at most `LEARNT` rows."""
        assert self._last is not None
        before = np.concatenate([self._last, values[:-1]]) if len(t) > 1 else self._last
        steps = np.abs(values - before)
        self._last, self._q, self._target = values[-1:], q[-1], target[-1]
        row, self._row = self._row % LEARNT, self._row + len(t)
        if steps.min() > 0.0 and self._goes_on_all:
            end = row + len(t)
            self._changes[row:end] = steps[: LEARNT - row]
            self._changes[: max(0, end - LEARNT)] = steps[LEARNT - row :]
            self._since[:], self._repeats[:] = t[-1], 0
            self._marks = dict.fromkeys(self.names, (q[-1], target[-1]))
            return
        changed, into = values != before, (row + np.arange(len(t))) % LEARNT
        # A column that stands keeps its noise; one that changes after it stood may rest, and its
        # noise is learnt again.
        resumed = latest_row(changed & ~np.concatenate([self._goes_on[None], changed[:-1]]))
        self._changes[:, resumed >= 0] = 0.0
        known = changed & (np.arange(len(changed))[:, None] >= resumed)
        self._changes[into] = np.where(known, steps, self._changes[into])
        self._goes_on = changed[-1]
        self._goes_on_all = bool(self._goes_on.all())
        latest = latest_row(changed)
        self._repeats = np.where(latest < 0, self._repeats, -1) + len(t) - np.maximum(latest, 0)
        went_on = latest >= 0
        self._since[went_on] = t[latest[went_on]]
        for name, columns in self._columns.items():
            row = int(latest[columns].max())
            if row >= 0:
                self._marks[name] = q[row], target[row]


def frozen(signals: Constancy, t: float) -> Fault | None:
    """Find the first frozen signal: `encoders`, or one that forces cause."""
    if not signals.stands(t):
        return None
    found = frozen_encoders(signals, t)
    for name in signals.names:
        if name != ENCODERS:
            found = found or frozen_torques(name, signals, t)
    return found


def frozen_torques(name: str, signals: Constancy, t: float) -> Fault | None:
    """Test a signal that forces cause: it changes with the arm's posture, or by its noise."""
    since, lasted, moved = signals.since(name), signals.lasted(name, t), signals.moved(name)
    if lasted.min() >= FROZEN and moved > MOVED:
        why = f"while a joint turned by {1e3 * moved:.1f} mrad"
        return frozen_fault(name, t, float(since.max()), why)
    stands = lasted >= FROZEN
    if stands.any():
        stands &= signals.noisy(name)
    if not stands.any():
        return None
    columns = ", ".join(str(i + 1) for i in np.flatnonzero(stands))
    why = f"in column {columns}, whose noise let it never rest before"
    return frozen_fault(name, t, float(since[stands].min()), why)


def frozen_encoders(signals: Constancy, t: float) -> Fault | None:
    """Test the joint positions: they change when the arm is led on, even against an obstacle."""
    since, led = signals.since(ENCODERS), signals.led(ENCODERS)
    if signals.lasted(ENCODERS, t).min() < FROZEN or led < LED:
        return None
    why = f"while the arm was led on by {1e3 * led:.1f} mm"
    return frozen_fault(ENCODERS, t, float(since.max()), why)


def frozen_fault(name: str, t: float, since: float, why: str) -> Fault:
    """Describe a frozen signal."""
    return Fault(f"frozen {name}", f"the same to the last bit for {t - since:.2f} s {why}", since)


def latest_row(changed: Mask) -> NDArray[np.intp]:
    """Return the last row in which each column of `changed` (m, n) is True; -1 for none."""
    rows = np.arange(len(changed))[:, None]
    return np.where(changed, rows, -1).max(axis=0)
