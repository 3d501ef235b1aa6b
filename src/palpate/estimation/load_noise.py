"""Noise of the joint signals, and the rows with and without an object in the hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array
from palpate.estimation.estimate import KNOWN
from palpate.estimation.motion import Mask
from palpate.trace.samples import Trace

SHORT_BLOCK = 0.05
"""s: means over such blocks show the white noise; longer than the memory of a filter of the signals. Sensitive: mass
0.2 σ, std ×0.9–1.2."""
LONG_BLOCK = 0.25
"""s: means over such blocks show slower noise; some of them fit into the shortest pass. Sensitive: mass 0.3 σ, std
×0.8–1.5."""
SMOOTH_DEGREE = 2
"""degree of the polynomial in time that is no noise of a stretch. Sensitive: mass 0.1 σ, std ×0.9–1.2."""
FLICKER_SPAN = 4.0
"""s for which white noise is averaged in a pass, to compare it with what is slower. Sensitive: no."""
FLICKER_FREEDOM = (6.0, 20.0)
"""degrees of freedom that the level of 1/f noise has at least and at most, between which the number of blocks of
`LONG_BLOCK` decides: where it hardly exceeds white noise it is known to a factor of two or so; where many blocks
show it, it is still extrapolated to a run of some ten seconds (in 75 recorded runs with a known level its square
came out at 0.7 to 1.25 of that). Sensitive: 95 % intervals ×0.9–1, no std."""
GAP = 3.0
"""sampling periods from which samples are missing. Sensitive: no."""
STANDS_OUT = 2.0
"""standard deviations of the excess scatter of long blocks over white noise from which it counts as 1/f noise.
Sensitive: mass 0.2 σ, std ×0.8–1.2."""
OVERLAP = 2.0
"""second differences of neighbouring blocks per independent one. Sensitive: mass 0.1 σ, std ×0.9–1.1."""
FLICKER_TIMES = tuple(0.3 * 4.0**i for i in range(6))
"""s: time constants of the processes whose sum is 1/f noise; from what blocks see to the length of a long run.
Sensitive: hardly."""
UNKNOWN_NOISE = 0.01
"""N², (N m)²: variance of a row where no rest is long enough to show it. Sensitive: no."""

Rows = NDArray[np.intp] | slice
"""Rows of a trace's samples."""

TINY = 1e-300
"""Keeps perfect signals from a division by zero."""
RANK = 1e-9
"""Singular values below this share of the largest count as zero."""

FLICKER_HADAMARD = 0.5 * float(np.log(256.0 / 27.0))
"""Hadamard variance of noise of one-sided density h²/f, over h² (Riley, as above)."""


@dataclass(frozen=True, slots=True, eq=False)
class SignalLevels:
    """Noise levels of m signals, in squared units of the signals.

    Attributes:
        white: (m,) variance that the mean of n rows has, times n.
        flicker: (m,) h², level at 1 Hz of a density h²/f, as far as it exceeds white noise.
        freedom: degrees of freedom of both together over seconds.
    """

    white: Array
    flicker: Array
    freedom: float


def block_noise(signals: Array, t: Array, cause: Array, windows: Sequence[Rows]) -> SignalLevels:
    """Noise of signals (n, m) with time stamps `t` (n,), from rows of `windows`, without a polynomial in time
    and what is in proportion to a known `cause` (n,), the acceleration of the arm."""
    stretches: list[_Stretch] = []
    for rows in windows:
        every, times = np.arange(len(t))[rows], t[rows]
        if len(times) < 2:
            continue
        gaps = np.flatnonzero(np.diff(times) > GAP * float(np.median(np.diff(times))))
        for part in np.split(every, gaps + 1):
            if len(part) > SMOOTH_DEGREE + 2:
                stretches.append(_stretch(signals[part], t[part], cause[part]))
    short = _differences(stretches, SHORT_BLOCK)
    if short is None:
        count = int(signals.shape[1])
        return SignalLevels(np.full(count, UNKNOWN_NOISE), np.zeros(count), KNOWN)
    long, white = _differences(stretches, LONG_BLOCK), short.white
    sure = max(short.count / OVERLAP, 1.0)
    if long is None:
        return SignalLevels(white, np.zeros_like(white), sure)
    # The median of all signals decides whether noise slower than white exceeds it.
    excess = float(np.median(long.white / np.maximum(white, TINY))) - 1.0
    unsure = float(np.sqrt(2.0 * OVERLAP / (long.count * len(white))))
    beyond = max(0.0, excess - STANDS_OUT * unsure)
    slow = beyond / (FLICKER_HADAMARD * (long.rows - short.rows))
    share = slow / (slow + short.period / FLICKER_SPAN)
    # Few blocks show the slow noise, and its level is extrapolated.
    least, most = FLICKER_FREEDOM
    exceeds = (beyond / max(unsure * (1.0 + excess), TINY)) ** 2
    freedom_slow = max(least, most * exceeds / (exceeds + 0.5 * most))
    freedom = 1.0 / (share**2 / freedom_slow + (1.0 - share) ** 2 / sure)
    return SignalLevels(white, slow * white, freedom)


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
    smooth = np.column_stack([np.vander(x, SMOOTH_DEGREE + 1), cause])
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
    times = FLICKER_TIMES
    step = float(np.log(times[1] / times[0]))
    out = np.zeros_like(apart)
    for time in times:
        out += step * np.exp(-apart / time)
    return out


# Rows of a trace with an object in the hand, and with an empty hand.


@dataclass(frozen=True, slots=True, eq=False)
class LoadRows:
    """Rows of a trace with the object in the hand and with an empty hand; rows while the fingers move are
    in neither. `grasps`: s, when the content of the hand changed to or from the object."""

    loaded: Mask
    empty: Mask
    grasps: tuple[float, ...]


def load_rows(trace: Trace, name: str | None) -> LoadRows:
    """Rows in which `name` was held, from the symbolic contexts of the leaves."""
    t = trace.samples.t
    loaded, empty = np.zeros(len(t), dtype=bool), np.ones(len(t), dtype=bool)
    held: str | None = None
    grasps: list[float] = []
    for leaf in sorted(trace.leaves, key=lambda run: run.end):
        if leaf.context is None or leaf.context.holding == held:
            continue
        if name in (held, leaf.context.holding):
            grasps.append(leaf.end if leaf.context.holding else leaf.start)
        held = leaf.context.holding
        loaded[t >= leaf.start] = empty[t >= leaf.start] = False
        loaded[t > leaf.end] = held == name and held is not None
        empty[t > leaf.end] = held is None
    return LoadRows(loaded, empty, tuple(grasps))
