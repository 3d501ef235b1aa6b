"""Slow and coloured noise of the torque signals: drift, warming up, flicker, what zeroing left."""

from __future__ import annotations

import math

import numpy as np

from palpate.geometry.pose import Array
from palpate.robots.simulated.noise.model import Flicker, Torque
from palpate.robots.simulated.noise.values import JOINTS, Streams

WALK_TIME = 300.0
"""s: a random walk has no stationary size; it spreads as a drift of that size and this time
constant begins to, and never turns back."""
PER_DECADE = 3
"""Relaxations that make up 1/f noise: their sum is within 3 % of it."""


class Relaxation:
    """An Ornstein-Uhlenbeck process, exact at whatever steps: `size` stationary, of `shape`."""

    def __init__(self, size: Array | float, time: float, random: np.random.Generator, count: int):
        self._size, self._time, self._random = size, time, random
        self._count = count
        walks = math.isinf(time)
        self.value: Array = np.zeros(count) if walks else size * random.standard_normal(count)
        """(count,) now; a random walk starts at nothing."""

    def after(self, duration: float) -> Array:
        """(count,) `duration` s later."""
        drawn = self._random.standard_normal(self._count)
        if math.isinf(self._time):
            self.value = self.value + self._size * math.sqrt(2 * duration / WALK_TIME) * drawn
            return self.value
        kept = math.exp(-duration / self._time)
        self.value = kept * self.value + self._size * math.sqrt(1 - kept * kept) * drawn
        return self.value


class FlickerNoise:
    """1/f noise of seven joints as a sum of relaxations whose corners are spaced evenly on a log
    axis.

    One of variance v and corner f_k has the one-sided power spectral density (2 v / pi f_k) /
    (1 + (f / f_k)^2). Spaced by a factor r, their sum is v / (f ln r) between the lowest and the
    highest corner, flat below, and falls as 1 / f^2 above; half of it is left at the corners.
    """

    def __init__(self, flicker: Flicker, period: float, random: np.random.Generator) -> None:
        low, high = flicker.band
        count = max(2, math.ceil(PER_DECADE * math.log10(high / low)) + 1)
        corners = np.geomspace(low, high, count)
        size = flicker.level * math.sqrt(math.log(corners[1] / corners[0]))
        self._keep = np.exp(-2 * np.pi * corners * period)[:, None]
        self._kick = np.sqrt(1 - self._keep**2) * size
        self._random, self._parts = random, size * random.standard_normal((count, JOINTS))

    def after(self, periods: int) -> Array:
        """(periods, 7) N m."""
        drawn = self._random.standard_normal((periods, *self._parts.shape))
        drawn *= self._kick
        out = np.empty((periods, JOINTS))
        for i in range(periods):
            self._parts *= self._keep
            self._parts += drawn[i]
            out[i] = self._parts.sum(0)
        return out


class Wander:
    """All that the signals show of their own accord, but white noise.

    Attributes:
        left: (7,) N m that zeroing leaves.
    """

    def __init__(self, torque: Torque, period: float, streams: Streams) -> None:
        drift = torque.drift
        self._period, self._t, self._warming = period, 0.0, drift.warm_up_time
        self.left = torque.offset.draw(streams.run("torque.offset"))
        self._drift = None
        if drift.size.any():
            random = streams.run("torque.drift")
            self._drift = Relaxation(drift.size, drift.time_constant, random, JOINTS)
        self._warm = None
        if drift.warm_up.any:
            self._warm = drift.warm_up.draw(streams("torque.drift.warm_up"))
        self._flicker = None
        if torque.flicker.level.any():
            self._flicker = FlickerNoise(torque.flicker, period, streams.run("torque.flicker"))

    @property
    def now(self) -> Array:
        """(7,) N m of drift, which changes with minutes."""
        return np.zeros(JOINTS) if self._drift is None else self._drift.value

    def add(self, reading: Array) -> None:
        """Add it to the readings (n, 7), N m, of n log periods."""
        duration = len(reading) * self._period
        self._t += duration
        if self._drift is not None:
            reading += self._drift.after(duration)
        if self._warm is not None:
            reading += self._warm * -math.expm1(-self._t / self._warming)
        if self._flicker is not None:
            reading += self._flicker.after(len(reading))
