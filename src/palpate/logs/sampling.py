"""Signals of a recording on an even clock, and in a band of frequencies."""

from __future__ import annotations

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.signal import butter, sosfiltfilt

from palpate.geometry.pose import Array


def resampled(t: Array, values: Array, rate: float) -> tuple[Array, Array]:
    """Average a signal (n, k) over periods of an even clock, `rate` Hz: the times (m,) of their
    middles, and the means (m, k)."""
    edges = np.arange(t[0], t[-1], 1.0 / rate)
    area = cumulative_trapezoid(values, t, axis=0, initial=0.0)
    at = np.stack([np.interp(edges, t, column) for column in area.T], axis=1)
    return (edges[1:] + edges[:-1]) / 2, np.diff(at, axis=0) * rate


def banded(values: Array, rate: float, low: float | None, high: float | None) -> Array:
    """Filter a signal (n, ...), `rate` Hz, without lag to the band from `low` to `high` Hz."""
    edges = [edge for edge in (low, high) if edge is not None]
    kind = "bandpass" if len(edges) == 2 else "lowpass" if low is None else "highpass"
    band = edges if len(edges) == 2 else edges[0]
    return sosfiltfilt(butter(4, band, kind, fs=rate, output="sos"), values, axis=0)
