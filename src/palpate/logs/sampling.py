"""Signals of a recording on an even clock, and in a band of frequencies."""

from __future__ import annotations

import numpy as np

from palpate.geometry.pose import Array


def resampled(t: Array, values: Array, rate: float) -> tuple[Array, Array]:
    """Average a signal (n, k) over periods of an even clock, `rate` Hz: the times (m,) of their
    middles, and the means (m, k)."""
    edges = np.arange(t[0], t[-1], 1.0 / rate)
    area = np.zeros(values.shape)  # of the signal, up to each sample
    area[1:] = np.cumsum((values[1:] + values[:-1]) * (np.diff(t)[:, None] / 2), axis=0)
    means = np.empty((len(edges) - 1, values.shape[1]))
    for k in range(values.shape[1]):
        means[:, k] = np.diff(np.interp(edges, t, area[:, k])) * rate
    return (edges[1:] + edges[:-1]) / 2, means


def banded(values: Array, rate: float, low: float | None, high: float) -> Array:
    """Filter a signal (n, ...), `rate` Hz, without lag to the band from `low` to `high` Hz."""
    from scipy.signal import butter, sosfiltfilt  # takes longer to load than most plans to make

    below = sosfiltfilt(butter(4, high, fs=rate, output="sos"), values, axis=0)
    return (
        below
        if low is None
        else below - sosfiltfilt(butter(4, low, fs=rate, output="sos"), below, axis=0)
    )
