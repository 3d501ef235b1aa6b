"""Noise of the joint signals, and the rows with and without an object in the hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array
from palpate.estimation.estimate import KNOWN
from palpate.estimation.motion import GAP, Mask
from palpate.trace.samples import Trace

SHORT_BLOCK = 0.05
"""s: block length whose means show the white noise; longer than the memory of a signal filter.
Sensitive: mass 0.2 σ, std ×0.9–1.2."""
LONG_BLOCK = 0.25
"""s: block length whose means show slower noise; some fit into the shortest pass. Sensitive: mass
0.3 σ, std ×0.8–1.5."""
SMOOTH_DEGREE = 2
"""degree of the polynomial in time that is removed from a stretch and does not count as noise.
Sensitive: mass 0.1 σ, std ×0.9–1.2."""
FLICKER_SPAN = 4.0
"""s: averaging time of a pass, at which white noise is compared with slower noise. Not sensitive."""
FLICKER_FREEDOM = (6.0, 20.0)
"""least and greatest degrees of freedom of the 1/f noise level; the number of blocks of
`LONG_BLOCK` decides between them. A level that hardly exceeds white noise is known to a factor of
about two. Even with many blocks it is extrapolated to a run of some ten seconds: in 75 recorded
runs with a known level its square came out at 0.7 to 1.25 of that. Sensitive: 95 % intervals
×0.9–1, no std."""
STANDS_OUT = 2.0
"""standard deviations of the excess scatter of long blocks over white noise from which it counts as
1/f noise. Sensitive: mass 0.2 σ, std ×0.8–1.2."""
OVERLAP = 2.0
"""second differences of neighbouring blocks per independent one. Sensitive: mass 0.1 σ, std ×0.9–1.1."""
FLICKER_TIMES = tuple(0.3 * 4.0**i for i in range(6))
"""s: time constants of the processes whose sum is 1/f noise, from the block length to that of a
long run. Hardly sensitive."""
UNKNOWN_NOISE = 0.01
"""N², (N m)²: variance of a row where no rest is long enough to show it. Not sensitive."""

Rows = NDArray[np.intp] | slice
"""Rows of a trace's samples."""

MEDIAN_VARIANCE = 0.5 * float(np.pi)
"""Variance of the median of many normal values, over that of their mean."""
TINY = 1e-300
"""Avoids a division by zero with perfect signals."""
RANK = 1e-9
"""Singular values below this share of the largest count as zero."""

FLICKER_HADAMARD = 0.5 * float(np.log(256.0 / 27.0))
"""Hadamard variance of noise of one-sided density h²/f, over h² (W. J. Riley, Handbook of Frequency
Stability Analysis, NIST SP 1065)."""


@dataclass(frozen=True, slots=True, eq=False)
class SignalLevels:
    """Noise levels of m signals, in squared units of the signals."""

    white: Array  # (m,) variance that the mean of n rows has, times n
    flicker: Array  # (m,) h², level at 1 Hz of a density h²/f, as far as it exceeds white noise
    freedom: float  # degrees of freedom of both together over seconds


def block_noise(signals: Array, t: Array, cause: Array, windows: Sequence[Rows]) -> SignalLevels:
    """Estimate the noise of signals (n, m) from the rows of `windows`.

    A polynomial in time, and the part in proportion to a known `cause`, are removed first.

    Args:
        t: (n,) s, time stamps.
        cause: (n,) acceleration of the arm.
    """
    # Split the windows at gaps, and remove trend and cause from each stretch.
    stretches: list[_Stretch] = []
    for rows in windows:
        every, times = np.arange(len(t))[rows], t[rows]
        if len(times) < 2:
            continue
        gaps = np.flatnonzero(np.diff(times) > GAP * float(np.median(np.diff(times))))
        for part in np.split(every, gaps + 1):
            if len(part) > SMOOTH_DEGREE + 2:
                stretches.append(_stretch(signals[part], t[part], cause[part]))
    # White noise from short blocks; without any, a default.
    short = _differences(stretches, SHORT_BLOCK)
    if short is None:
        count = int(signals.shape[1])
        return SignalLevels(np.full(count, UNKNOWN_NOISE), np.zeros(count), KNOWN)
    long, white = _differences(stretches, LONG_BLOCK), short.white
    # Without long blocks, all noise counts as white.
    sure = max(short.count / OVERLAP, 1.0)
    if long is None:
        return SignalLevels(white, np.zeros_like(white), sure)
    # Excess of long blocks over white noise: the median over the signals, less its own scatter.
    # Both block lengths scatter, and a median scatters more than a mean of normal values.
    excess = float(np.median(long.white / np.maximum(white, TINY))) - 1.0
    counts = 1.0 / long.count + 1.0 / short.count
    unsure = float(np.sqrt(MEDIAN_VARIANCE * 2.0 * OVERLAP * counts / len(white)))
    beyond = max(0.0, excess - STANDS_OUT * unsure)
    # Level of 1/f noise over white noise, and its share in the variance of a pass.
    slow = beyond / (FLICKER_HADAMARD * (long.rows - short.rows))
    share = slow / (slow + short.period / FLICKER_SPAN)
    # Degrees of freedom: few for the slow noise, whose level is extrapolated from few blocks.
    least, most = FLICKER_FREEDOM
    exceeds = (beyond / max(unsure * (1.0 + excess), TINY)) ** 2
    freedom_slow = max(least, most * exceeds / (exceeds + 0.5 * most))
    freedom = 1.0 / (share**2 / freedom_slow + (1.0 - share) ** 2 / sure)
    return SignalLevels(white, slow * white, freedom)


@dataclass(frozen=True, slots=True, eq=False)
class _Stretch:
    """Rows without a gap."""

    period: float  # s
    basis: Array  # (n, p) orthonormal, of the fitted trend and cause
    left: Array  # (n, m) residuals of the signals


def _stretch(signals: Array, t: Array, cause: Array) -> _Stretch:
    """Fit and remove trend and cause by a rank-revealing SVD."""
    x = 2.0 * (t - t[0]) / max(float(t[-1] - t[0]), TINY) - 1.0
    smooth = np.column_stack([np.vander(x, SMOOTH_DEGREE + 1), cause])
    basis, sizes, _ = np.linalg.svd(smooth, full_matrices=False)
    basis = basis[:, sizes > RANK * sizes[0]]
    return _Stretch(float(np.median(np.diff(t))), basis, signals - basis @ (basis.T @ signals))


@dataclass(frozen=True, slots=True, eq=False)
class _Differences:
    """Second differences of block means."""

    white: Array  # (m,) variance of a row if all noise were white
    rows: int  # in a block
    period: float  # s, of the samples
    count: int  # number of differences


def _differences(stretches: Sequence[_Stretch], block: float) -> _Differences | None:
    """Take second differences over blocks of `block` s; None where no stretch is long enough."""
    if not stretches:
        return None
    period = float(np.median([stretch.period for stretch in stretches]))
    size = max(1, round(block / max(period, TINY)))
    # Pool all stretches: squared differences over their expectation for unit white noise.
    total, weight, count = np.zeros(stretches[0].left.shape[1]), 0.0, 0
    for stretch in stretches:
        second = second_differences(stretch.left, size)
        total = total + (second**2).sum(axis=0)
        # White noise of unit variance gives 6 / size to each, less the part in the fitted basis.
        weight += 6.0 * len(second) / size - float(
            (second_differences(stretch.basis, size) ** 2).sum()
        )
        count += len(second)
    if weight * size < 1.0:
        return None
    return _Differences(total / weight, size, period, count)


def second_differences(signals: Array, size: int) -> Array:
    """Take the (k, m) second differences of means over blocks of `size` rows."""
    count = len(signals) // size
    blocks = signals[: count * size].reshape(count, size, signals.shape[1])
    return np.diff(blocks.mean(axis=1), n=2, axis=0)


def flicker(apart: Array) -> Array:
    """Compute the covariance of noise of density 1/f at time lags `apart`, s, of the same shape.

    It is a sum of processes with time constants evenly spaced in their logarithm (Riley, section
    3.3).
    """
    times = FLICKER_TIMES
    # Each process has the weight of its step in log time.
    step = float(np.log(times[1] / times[0]))
    out = np.zeros_like(apart)
    for time in times:
        out += step * np.exp(-apart / time)
    return out


# Rows of a trace with an object in the hand and with an empty hand.


@dataclass(frozen=True, slots=True, eq=False)
class LoadRows:
    """Rows of a trace with the object in the hand and with an empty hand.

    Rows while the fingers move are in neither.
    """

    loaded: Mask  # (n,) with the object
    empty: Mask  # (n,) with an empty hand
    # s, times at which the content of the hand changed to or from the object.
    grasps: tuple[float, ...]


def load_rows(trace: Trace, name: str | None) -> LoadRows:
    """Find the rows in which `name` was held, from the symbolic contexts of the leaves."""
    t = trace.samples.t
    loaded, empty = np.zeros(len(t), dtype=bool), np.ones(len(t), dtype=bool)
    held: str | None = None
    grasps: list[float] = []
    for leaf in sorted(trace.leaves, key=lambda run: run.end):
        if leaf.context is None or leaf.context.holding == held:
            continue
        # A grasp takes effect at the end of its leaf, a release at its start.
        if name in (held, leaf.context.holding):
            grasps.append(leaf.end if leaf.context.holding else leaf.start)
        # Rows during the change belong to neither state.
        held = leaf.context.holding
        loaded[t >= leaf.start] = empty[t >= leaf.start] = False
        loaded[t > leaf.end] = held == name and held is not None
        empty[t > leaf.end] = held is None
    return LoadRows(loaded, empty, tuple(grasps))
