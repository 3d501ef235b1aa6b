"""Noise of the signals, estimated from the signals alone, at rest or in smooth motion.

Means over neighbouring blocks differ by the noise, and their second differences cancel a linear trend. A
sixth of their mean square is the Hadamard variance; that of white noise falls with the length of the block,
that of 1/f noise does not (W. J. Riley, Handbook of Frequency Stability Analysis, NIST SP
1065, 2008, section 5.2.10).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.estimation import tuning
from palpate.estimation.agreement import KNOWN
from palpate.geometry.pose import Array

Rows = NDArray[np.intp] | slice
"""Rows of a trace's samples."""

TINY = 1e-300
"""Keeps perfect signals from a division by zero."""
RANK = 1e-9
"""Singular values below this share of the largest count as zero."""

FLICKER_HADAMARD = 0.5 * float(np.log(256.0 / 27.0))
"""Hadamard variance of noise of one-sided density h²/f, over h² (Riley, as above)."""


@dataclass(frozen=True, slots=True, eq=False)
class Noise:
    """Noise levels of m signals, in squared units of the signals.

    Attributes:
        white: (m,) variance that the mean of n rows has, times n.
        flicker: (m,) h², level at 1 Hz of a density h²/f, as far as it exceeds white noise.
        freedom: degrees of freedom of both together over seconds.
    """

    white: Array
    flicker: Array
    freedom: float


def block_noise(signals: Array, t: Array, cause: Array, windows: Sequence[Rows]) -> Noise:
    """Noise of signals (n, m) with time stamps `t` (n,), from rows of `windows`, without a polynomial in time
    and what is in proportion to a known `cause` (n,), the acceleration of the arm."""
    stretches: list[_Stretch] = []
    for rows in windows:
        every, times = np.arange(len(t))[rows], t[rows]
        if len(times) < 2:
            continue
        gaps = np.flatnonzero(np.diff(times) > tuning.GAP * float(np.median(np.diff(times))))
        for part in np.split(every, gaps + 1):
            if len(part) > tuning.SMOOTH_DEGREE + 2:
                stretches.append(_stretch(signals[part], t[part], cause[part]))
    short = _differences(stretches, tuning.SHORT_BLOCK)
    if short is None:
        count = int(signals.shape[1])
        return Noise(np.full(count, tuning.UNKNOWN_NOISE), np.zeros(count), KNOWN)
    long, white = _differences(stretches, tuning.LONG_BLOCK), short.white
    sure = max(short.count / tuning.OVERLAP, 1.0)
    if long is None:
        return Noise(white, np.zeros_like(white), sure)
    # The median of all signals decides whether noise slower than white exceeds it.
    excess = float(np.median(long.white / np.maximum(white, TINY))) - 1.0
    unsure = float(np.sqrt(2.0 * tuning.OVERLAP / (long.count * len(white))))
    beyond = max(0.0, excess - tuning.STANDS_OUT * unsure)
    slow = beyond / (FLICKER_HADAMARD * (long.rows - short.rows))
    share = slow / (slow + short.period / tuning.FLICKER_SPAN)
    # Few blocks show the slow noise, and its level is extrapolated.
    least, most = tuning.FLICKER_FREEDOM
    exceeds = (beyond / max(unsure * (1.0 + excess), TINY)) ** 2
    freedom_slow = max(least, most * exceeds / (exceeds + 0.5 * most))
    freedom = 1.0 / (share**2 / freedom_slow + (1.0 - share) ** 2 / sure)
    return Noise(white, slow * white, freedom)


@dataclass(frozen=True, slots=True, eq=False)
class _Stretch:
    """Rows without a gap.

    Attributes:
        period: s.
        basis: (n, p) orthonormal, of the fitted trend and cause.
        left: (n, m) residuals of the signals.
    """

    period: float
    basis: Array
    left: Array


def _stretch(signals: Array, t: Array, cause: Array) -> _Stretch:
    x = 2.0 * (t - t[0]) / max(float(t[-1] - t[0]), TINY) - 1.0
    smooth = np.column_stack([np.vander(x, tuning.SMOOTH_DEGREE + 1), cause])
    basis, sizes, _ = np.linalg.svd(smooth, full_matrices=False)
    basis = basis[:, sizes > RANK * sizes[0]]
    return _Stretch(float(np.median(np.diff(t))), basis, signals - basis @ (basis.T @ signals))


@dataclass(frozen=True, slots=True, eq=False)
class _Differences:
    """`count` second differences of means over blocks of `rows` at a `period`, s; `white` (m,): variance of a
    row if all noise were white."""

    white: Array
    rows: int
    period: float
    count: int


def _differences(stretches: Sequence[_Stretch], block: float) -> _Differences | None:
    """Over blocks of `block` s; None where no stretch is long enough."""
    if not stretches:
        return None
    period = float(np.median([stretch.period for stretch in stretches]))
    size = max(1, round(block / max(period, TINY)))
    total, weight, count = np.zeros(stretches[0].left.shape[1]), 0.0, 0
    for stretch in stretches:
        second = second_differences(stretch.left, size)
        total = total + (second**2).sum(axis=0)
        # White noise of unit variance has 6 / size in each, minus the part in the fitted basis.
        weight += 6.0 * len(second) / size - float(
            (second_differences(stretch.basis, size) ** 2).sum()
        )
        count += len(second)
    if weight * size < 1.0:
        return None
    return _Differences(total / weight, size, period, count)


def second_differences(signals: Array, size: int) -> Array:
    """(k, m) second differences of means over blocks of `size` rows."""
    count = len(signals) // size
    blocks = signals[: count * size].reshape(count, size, signals.shape[1])
    return np.diff(blocks.mean(axis=1), n=2, axis=0)


def flicker(apart: Array) -> Array:
    """(n, n) covariance of noise of density 1/f, at times `apart`, s: a sum of processes with time constants
    evenly spaced in their logarithm (Riley, as above, section 3.3)."""
    times = tuning.FLICKER_TIMES
    step = float(np.log(times[1] / times[0]))
    out = np.zeros_like(apart)
    for time in times:
        out += step * np.exp(-apart / time)
    return out
