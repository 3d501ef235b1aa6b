"""Data acquisition: from sensor readings to logged samples and their time stamps."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array
from palpate.robots.simulated.noise.model import Acquisition, Streams, Torque
from palpate.robots.simulated.timing import BLOCK, PERIOD, TIMESTEP

TAIL = 2  # degrees of freedom of Student's t distribution, from which outliers are drawn
LATEST = 0.45  # of a log period: largest error of a stamp, so that samples stay in order


class SignalLine:
    """White noise, filter, delay, quantisation, outliers, repeats and gaps of the torque samples.

    It makes the means of blocks of 1 kHz samples. It makes single samples only where an error needs them.
    """

    def __init__(self, torque: Torque, acquisition: Acquisition, streams: Streams) -> None:
        self._torque, self._white = torque, streams.run("torque.white")
        self._mean = torque.white / math.sqrt(BLOCK)
        self._noisy = bool(self._mean.any())
        self._outliers, self._odd = acquisition.outliers, streams.run("acquisition.outliers")
        self._repeated, self._again = acquisition.repeated, streams.run("acquisition.repeated")
        self._gaps = Gaps(acquisition, streams) if acquisition.dropped.rate else None
        self._strays = bool(self._outliers.rate and self._outliers.size.any())
        self._coarse = bool(torque.quantisation.any())
        self._all_coarse = bool(torque.quantisation.all())
        # Only some errors need single samples; otherwise block means suffice.
        others = torque.filter or torque.delay or self._repeated
        self._single = self._coarse or self._strays or bool(others or self._gaps)
        self._bounded = bool(np.isfinite(torque.range).any())
        # Single samples (n, 7), N m, of each run, before any is lost; None if they are not kept.
        self.kept: tuple[Array, ...] | None = None
        # State between runs; empty at first.
        joints = len(torque.white)
        self._filtered = self._late = self._last = np.empty((0, joints))
        self._held = np.zeros(joints)

    def carry(self, reading: Array) -> tuple[Array, NDArray[np.bool_] | None]:
        """Compute the block means (n, 7), N m, of the readings (n, 7), which may be overwritten.

        Returns:
            The means, with the last one repeated for lost blocks; and a mask of the blocks that arrive, None
            for all of them.
        """
        # Block means suffice: their white noise is smaller by sqrt(BLOCK).
        if not self._single and self.kept is None:
            if self._noisy:
                reading += self._mean * self._white.standard_normal(reading.shape)
            return self._saturate(reading), None
        # Apply the errors of the 1 kHz samples in turn.
        samples = np.repeat(reading, BLOCK, axis=0)
        samples += self._torque.white * self._white.standard_normal(samples.shape)
        samples = self._delay(self._filter(samples))
        if self._coarse:
            samples = self._quantise(samples)
        samples = self._saturate(samples)
        if self._strays:
            self._add_outliers(samples)
        samples = self._repeat(samples)
        if self.kept is not None:
            self.kept = (*self.kept, samples)  # a state that may be restored
        blocks = samples.reshape(-1, BLOCK, samples.shape[1])
        if self._gaps is None:
            return blocks.mean(axis=1), None
        # Samples in gaps are left out of the means; a block without any keeps the last mean.
        arrived = self._gaps.arrived(len(samples)).reshape(-1, BLOCK)
        if arrived.all():
            mean = blocks.mean(axis=1)
            self._held = mean[-1]
            return mean, None
        count = arrived.sum(axis=1)
        mean = (blocks * arrived[:, :, None]).sum(axis=1) / np.maximum(count, 1)[:, None]
        for row in np.flatnonzero(count == 0):
            mean[row] = mean[row - 1] if row else self._held
        self._held = mean[-1]
        return mean, count > 0

    def _quantise(self, samples: Array) -> Array:
        """Round to whole quantisation steps in the joints that have one."""
        step = self._torque.quantisation
        if self._all_coarse:
            return np.round(samples / step) * step
        fine = np.where(step > 0, step, 1.0)
        return np.where(step > 0, np.round(samples / fine) * fine, samples)

    def _saturate(self, samples: Array) -> Array:
        if not self._bounded:
            return samples
        # np.clip takes three times as long.
        return np.minimum(np.maximum(samples, -self._torque.range), self._torque.range)

    def _filter(self, samples: Array) -> Array:
        """Apply a first-order low pass, started at the first sample."""
        if not self._torque.filter:
            return samples
        # Exponential smoothing with the corner frequency of the filter, Hz.
        keep = math.exp(-2 * math.pi * self._torque.filter * TIMESTEP)
        if not len(self._filtered):
            self._filtered = samples[:1]
        response, fade = low_pass(len(samples), keep)
        out = response @ samples + fade[:, None] * self._filtered
        self._filtered = out[-1:]
        return out

    def _delay(self, samples: Array) -> Array:
        """Delay the samples by `delay` s, interpolated linearly between two of them."""
        late = self._torque.delay / TIMESTEP
        if not late:
            return samples
        # Shift by whole samples, and interpolate the rest.
        whole, part = int(late), late - int(late)
        if not len(self._late):
            self._late = np.repeat(samples[:1], whole + 1, axis=0)
        known = np.concatenate([self._late, samples])
        n = len(samples)
        self._late = known[n:].copy()
        return (1.0 - part) * known[1 : n + 1] + part * known[:n]

    def _add_outliers(self, samples: Array) -> None:
        expected = self._outliers.rate * samples.size * TIMESTEP
        for _ in range(int(self._odd.poisson(expected))):
            row, joint = (int(self._odd.integers(int(size))) for size in samples.shape)
            samples[row, joint] += self._outliers.size[joint] * self._odd.standard_t(TAIL)

    def _repeat(self, samples: Array) -> Array:
        """Replace samples that are repeats by the last fresh one."""
        if not self._repeated:
            return samples
        fresh = self._again.random(len(samples)) >= self._repeated
        if fresh.all():
            self._last = samples[-1:]
            return samples
        # The row of the last fresh sample, for each sample.
        rows = np.where(fresh, np.arange(len(samples)), -1)
        np.maximum.accumulate(rows, out=rows)
        before = self._last if len(self._last) else samples[:1]
        out = np.where(rows[:, None] < 0, before, samples[rows])
        self._last = out[-1:]
        return out


class Gaps:
    """Gaps in the samples."""

    def __init__(self, acquisition: Acquisition, streams: Streams) -> None:
        self._rate, self._random = acquisition.dropped.rate, streams.run("acquisition.dropped")
        self._length = max(1, round(acquisition.dropped.length / TIMESTEP))
        self._left = 0  # samples of the last gap that extend into the next run

    def arrived(self, count: int) -> NDArray[np.bool_]:
        """Draw a mask of the next `count` samples that arrive."""
        arrived = np.ones(count, dtype=np.bool_)
        arrived[: self._left] = False
        self._left = max(0, self._left - count)
        for _ in range(int(self._random.poisson(self._rate * count * TIMESTEP))):
            first = int(self._random.integers(count))
            arrived[first : first + self._length] = False
            self._left = max(self._left, first + self._length - count)
        return arrived


class Stamps:
    """Robot time against world time: the rate of the robot's clock, and the jitter of its stamps."""

    def __init__(self, acquisition: Acquisition, streams: Streams) -> None:
        # s of robot time per second of world time.
        self.rate = 1.0 + acquisition.clock.number(streams("acquisition.clock"))
        self._jitter, self._random = acquisition.jitter, streams.run("acquisition.jitter")

    def of(self, t: Array) -> Array:
        """Stamp samples taken at world times `t` (n,), s."""
        if not self._jitter:
            return self.rate * t
        off = self._jitter * self._random.standard_normal(len(t))
        return self.rate * t + np.clip(off, -LATEST * PERIOD, LATEST * PERIOD)


@cache
def low_pass(count: int, keep: float) -> tuple[Array, Array]:
    """Return the filter's response to each of `count` inputs (count, count), and to the state before them (count,).

    y_i = keep^(i+1) y_0 + sum_j (1 - keep) keep^(i-j) x_j.
    """
    ages = np.subtract.outer(np.arange(count), np.arange(count))
    response = np.where(ages >= 0, (1.0 - keep) * keep ** np.maximum(ages, 0), 0.0)
    return response, keep ** np.arange(1.0, count + 1)
