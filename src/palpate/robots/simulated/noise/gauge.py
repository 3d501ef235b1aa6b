"""Torque sensors: gains and hysteresis of their gauges, and their drift and coloured noise."""

from __future__ import annotations

import math

import numpy as np

from palpate.geometry.pose import Array
from palpate.robots.simulated.noise.model import JOINTS, Flicker, Streams, Torque
from palpate.robots.simulated.noise.ripple import Resonator, Waves
from palpate.robots.simulated.timing import PERIOD

THRESHOLDS = 8  # play operators that make up the hysteresis, each half as wide as the one before
WIDEST = 0.25  # of the range: the widest of them
LOOP = math.sqrt(2.0)
"""Width of a loop of swing S over w S, at weights w: between 1 and 2, by where S lies between two
thresholds."""
WALK_TIME = 300.0
"""s: a random walk has no stationary size; it spreads as a drift of that size and this time
constant does in the beginning, and never turns back."""
AHEAD = 20  # log periods of 1/f noise that are drawn together
PER_DECADE = 3  # relaxations that make up 1/f noise: their sum is within 3 % of it


class Gauges:
    """Seven sensors with their robot's own gains, cross-talk, curvature, hysteresis and ripple."""

    def __init__(self, torque: Torque, tau_max: Array, streams: Streams) -> None:
        self._matrix = np.diag(1.0 + torque.gain_max.draw(streams("torque.gain_max")))
        crosstalk = torque.crosstalk.draw(streams("torque.crosstalk"))
        self._matrix += crosstalk - np.diag(np.diag(crosstalk))
        self._gain = np.diag(self._matrix).copy()
        self._crossed = torque.crosstalk.any
        full = np.where(np.isfinite(torque.range), torque.range, tau_max)
        self._curvature = None
        if torque.nonlinearity_max.any:
            drawn = torque.nonlinearity_max.draw(streams("torque.nonlinearity_max"))
            self._curvature = drawn / full
        self._waves = Waves(torque.ripple, streams("torque.ripple"))
        self._resonator = None
        if np.isfinite(torque.ripple.resonance.frequency).any():
            self._resonator = Resonator(torque.ripple.resonance, PERIOD)
        self._weight = torque.hysteresis / LOOP
        self._lags = bool(self._weight.any())
        self._half = WIDEST * full * 0.5 ** np.arange(THRESHOLDS)[:, None]
        self._plays: Array | None = None

    def read(self, torque: Array, q: Array) -> Array:
        """Compute the readings (n, 7), N m, at link-side torques (n, 7) and joint angles (n, 7)."""
        reading = torque @ self._matrix.T if self._crossed else self._gain * torque
        if self._curvature is not None:
            reading += self._curvature * torque * torque
        if self._lags:
            reading -= self._weight * self._lag(torque)
        if not self._waves.none:
            ripple = self._waves.at(q)
            reading += ripple if self._resonator is None else self._resonator.passed(ripple)
        return reading

    def _lag(self, torque: Array) -> Array:
        """Sum the lags (n, 7), N m, of play operators of all widths: a Prandtl-Ishlinskii model,
        whose loops are as wide as the swing since the last reversal is long (P. Krejci,
        "Hysteresis, Convexity and Dissipation in Hyperbolic Equations", 1996)."""
        before = self._plays
        if before is None:
            before = np.broadcast_to(torque[0], self._half.shape)
        low, high = torque[:, None] - self._half, torque[:, None] + self._half
        plays = np.empty_like(low)
        for i in range(len(torque)):
            before = np.minimum(np.maximum(before, low[i]), high[i], out=plays[i])
        self._plays = before
        return (torque[:, None] - plays).sum(1)


class Relaxation:
    """An Ornstein-Uhlenbeck process of `count` components, exact at any step; `size` stationary.

    Attributes:
        value: (count,) now; a random walk (infinite `time` constant) starts at zero.
    """

    def __init__(self, size: Array | float, time: float, random: np.random.Generator, count: int):
        self._size, self._time, self._random, self._count = size, time, random, count
        walks = math.isinf(time)
        self.value: Array = np.zeros(count) if walks else size * random.standard_normal(count)

    def after(self, duration: float) -> Array:
        """Advance by `duration` s and return the value (count,)."""
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
        keep = np.exp(-2 * np.pi * corners * period)[:, None]
        self._kick = np.sqrt(1 - keep**2) * size
        self._random, self._parts = random, size * random.standard_normal((count, JOINTS))
        # Response of each part to each kick of the rows ahead, and what is left of it now.
        ages = np.subtract.outer(np.arange(AHEAD), np.arange(AHEAD))
        self._response = np.tril(keep[:, None] ** np.maximum(ages, 0))
        self._fade = keep[:, None] ** np.arange(1.0, AHEAD + 1)[:, None]
        self._ahead: Array = np.empty((0, JOINTS))

    def after(self, periods: int) -> Array:
        """Advance by some log periods and return the noise (periods, 7), N m."""
        while len(self._ahead) < periods:
            self._ahead = np.concatenate([self._ahead, self._more()])
        out, self._ahead = self._ahead[:periods], self._ahead[periods:]
        return out

    def _more(self) -> Array:
        """Draw the noise (AHEAD, 7) of the rows ahead: no motion changes it."""
        drawn = self._random.standard_normal((AHEAD, *self._parts.shape)) * self._kick
        parts = self._response @ drawn.transpose(1, 0, 2) + self._fade * self._parts[:, None]
        self._parts = parts[:, -1]
        return parts.sum(0)


class Wander:
    """Slow and coloured noise of the torque signals: drift, warm-up, flicker, zeroing offset.

    Attributes:
        left: (7,) N m that zeroing leaves.
    """

    def __init__(self, torque: Torque, period: float, streams: Streams) -> None:
        drift = torque.drift
        self._period, self._t, self._warm_up_time = period, 0.0, drift.warm_up_time
        self.left = torque.offset.draw(streams.run("torque.offset"))
        self._drift = self._warm_up = self._flicker = None
        if drift.size.any():
            random = streams.run("torque.drift")
            self._drift = Relaxation(drift.size, drift.time_constant, random, JOINTS)
        if drift.warm_up.any:
            self._warm_up = drift.warm_up.draw(streams("torque.drift.warm_up"))
        if torque.flicker.level.any():
            self._flicker = FlickerNoise(torque.flicker, period, streams.run("torque.flicker"))

    @property
    def now(self) -> Array:
        """(7,) N m of drift now."""
        return np.zeros(JOINTS) if self._drift is None else self._drift.value

    def add(self, reading: Array) -> None:
        """Add the noise to the readings (n, 7), N m, of n log periods."""
        duration = len(reading) * self._period
        self._t += duration
        if self._drift is not None:
            reading += self._drift.after(duration)
        if self._warm_up is not None:
            reading += self._warm_up * -math.expm1(-self._t / self._warm_up_time)
        if self._flicker is not None:
            reading += self._flicker.after(len(reading))
