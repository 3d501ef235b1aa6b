"""From the sensors' readings to logged samples: white noise, filter, delay, quantisation, and what
happens to samples on the way."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from palpate.geometry.pose import Array
from palpate.robots.simulated.noise.model import Acquisition, Torque
from palpate.robots.simulated.noise.values import JOINTS, Streams
from palpate.robots.simulated.timing import BLOCK, TIMESTEP

TAIL = 2
"""Degrees of freedom of Student's t distribution, from which outliers are drawn."""


class Line:
    """Makes the means of blocks of 1 kHz samples. Where nothing looks at single samples, none are
    made."""

    def __init__(self, torque: Torque, acquisition: Acquisition, streams: Streams) -> None:
        self._torque, self._white = torque, streams.run("torque.white")
        self._mean = torque.white / math.sqrt(BLOCK)
        self._noisy = bool(self._mean.any())
        self._outliers = acquisition.outliers
        self._odd = streams.run("acquisition.outliers")
        self._repeated, self._again = acquisition.repeated, streams.run("acquisition.repeated")
        self._gaps = Gaps(acquisition, streams) if acquisition.dropped.rate else None
        self._strays = bool(self._outliers.rate and self._outliers.size.any())
        self._coarse = torque.quantisation.any()
        self._single = bool(
            self._coarse
            or torque.filter
            or torque.delay
            or self._strays
            or self._repeated
            or self._gaps
        )
        self._bounded = bool(np.isfinite(torque.range).all() or np.isfinite(torque.range).any())
        self._filtered = self._late = self._last = np.empty((0, JOINTS))
        """What the last run leaves to the next; nothing at first."""
        self._held = np.zeros(JOINTS)

    def carry(self, reading: Array) -> tuple[Array, NDArray[np.bool_] | None]:
        """The block means (n, 7), N m, of what arrives of the readings (n, 7), which it may change,
        and which blocks arrived at all, None for all of them; the last one stands for those that
        did not."""
        if not self._single:
            if self._noisy:
                reading += self._mean * self._white.standard_normal(reading.shape)
            return self._within(reading), None
        samples = np.repeat(reading, BLOCK, axis=0)
        samples += self._torque.white * self._white.standard_normal(samples.shape)
        samples = self._delay(self._filter(samples))
        if self._coarse:
            samples = self._quantised(samples)
        samples = self._repeat(self._stray(self._within(samples)))
        blocks = samples.reshape(-1, BLOCK, JOINTS)
        if self._gaps is None:
            return blocks.mean(axis=1), None
        arrived = self._gaps.arrived(len(samples)).reshape(-1, BLOCK)
        count = arrived.sum(axis=1)
        mean = (blocks * arrived[:, :, None]).sum(axis=1) / np.maximum(count, 1)[:, None]
        for row in np.flatnonzero(count == 0):
            mean[row] = mean[row - 1] if row else self._held
        self._held = mean[-1]
        return mean, count > 0

    def _within(self, samples: Array) -> Array:
        if not self._bounded:
            return samples
        return np.clip(samples, -self._torque.range, self._torque.range)

    def _quantised(self, samples: Array) -> Array:
        step = self._torque.quantisation
        fine = np.where(step > 0, step, 1.0)
        return np.where(step > 0, np.round(samples / fine) * fine, samples)

    def _filter(self, samples: Array) -> Array:
        """First-order low pass, started at the first sample."""
        if not self._torque.filter:
            return samples
        keep = math.exp(-2 * math.pi * self._torque.filter * TIMESTEP)
        if not len(self._filtered):
            self._filtered = samples[:1]
        response, fade = _low_pass(len(samples), keep)
        out = response @ samples + fade[:, None] * self._filtered
        self._filtered = out[-1:]
        return out

    def _delay(self, samples: Array) -> Array:
        """Each sample as it was `delay` s before, between two samples in proportion."""
        late = self._torque.delay / TIMESTEP
        if not late:
            return samples
        whole, part = int(late), late - int(late)
        if not len(self._late):
            self._late = np.repeat(samples[:1], whole + 1, axis=0)
        known = np.concatenate([self._late, samples])
        n = len(samples)
        self._late = known[n:].copy()
        return (1.0 - part) * known[1 : n + 1] + part * known[:n]

    def _stray(self, samples: Array) -> Array:
        if not self._strays:
            return samples
        expected = self._outliers.rate * samples.size * TIMESTEP
        count = int(self._odd.poisson(expected))
        for _ in range(count):
            row, joint = self._odd.integers(len(samples)), self._odd.integers(JOINTS)
            samples[row, joint] += self._outliers.size[joint] * self._odd.standard_t(TAIL)
        return samples

    def _repeat(self, samples: Array) -> Array:
        """A sample that is repeated stands in the place of those after it."""
        if not self._repeated:
            return samples
        fresh = self._again.random(len(samples)) >= self._repeated
        rows = np.where(fresh, np.arange(len(samples)), -1)
        np.maximum.accumulate(rows, out=rows)
        before = self._last if len(self._last) else samples[:1]
        out = np.where(rows[:, None] < 0, before, samples[rows])
        self._last = out[-1:]
        return out


class Gaps:
    """Samples that do not arrive."""

    def __init__(self, acquisition: Acquisition, streams: Streams) -> None:
        self._rate, self._random = acquisition.dropped.rate, streams.run("acquisition.dropped")
        self._length = max(1, round(acquisition.dropped.length / TIMESTEP))
        self._left = 0

    def arrived(self, count: int) -> NDArray[np.bool_]:
        """(count,) of the next samples."""
        arrived = np.ones(count, dtype=np.bool_)
        arrived[: self._left] = False
        self._left = max(0, self._left - count)
        for _ in range(int(self._random.poisson(self._rate * count * TIMESTEP))):
            first = int(self._random.integers(count))
            arrived[first : first + self._length] = False
            self._left = max(self._left, first + self._length - count)
        return arrived


@cache
def _low_pass(count: int, keep: float) -> tuple[Array, Array]:
    """Response of each output to each of `count` inputs (count, count), and to the state before
    (count,)."""
    ages = np.subtract.outer(np.arange(count), np.arange(count))
    response = np.where(ages >= 0, (1.0 - keep) * keep ** np.maximum(ages, 0), 0.0)
    return response, keep ** np.arange(1.0, count + 1)
