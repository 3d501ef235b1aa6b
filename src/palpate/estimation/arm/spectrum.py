"""Signals of an arm by frequency, up to `tuning.BAND`, and the noise that a fit leaves there.

The cosine transform of a stretch is orthonormal, needs no periodic signal, and makes the coefficients of
stationary noise nearly independent of each other (Rao and Yip, Discrete Cosine Transform, 1990): coloured noise
is a standard deviation per frequency. A cut-off is the same low-pass for torques and all that explains them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from palpate.estimation import tuning
from palpate.geometry.pose import Array


def transformed(signal: Array, step: float) -> Array:
    """(k, 7, …) coefficients of a signal (n, 7, …) at `step` s, up to the band's end."""
    from scipy.fft import dct

    return dct(signal, axis=0, norm="ortho")[: kept(len(signal), step)]


def kept(rows: int, step: float) -> int:
    """Number of coefficients up to the band's end, of so many rows at `step` s."""
    return min(rows, int(2.0 * tuning.BAND * step * rows))


def frequencies(count: int, rows: int, step: float) -> Array:
    """(count,) Hz of the coefficients of a stretch of `rows`; the first is given half a step."""
    return (np.arange(count, dtype=float) + 0.5) / (2.0 * rows * step)


@dataclass(frozen=True, slots=True, eq=False)
class SpectralNoise:
    """Independent noise of each row.

    Attributes:
        std: (n,) N m.
        freedom: degrees of freedom of it.
    """

    std: Array
    freedom: float

    @property
    def volume(self) -> float:
        """Half the log determinant of its covariance."""
        return float(np.log(self.std).sum())

    def white(self, rows: Array) -> Array:
        """Bring rows (n, p), or (n,), to unit variance."""
        return (rows.T / self.std).T


@dataclass(frozen=True, eq=False)
class Residual:
    """Shapes of the spectrum of what no cause explains: white, and more of it at low frequencies, as drift,
    friction of another law and ripple are.

    Attributes:
        frequency: (k,) Hz.
    """

    frequency: Array

    @cached_property
    def shapes(self) -> Array:
        """(s, k) power by frequency."""
        falling = [1.0 / (1.0 + (self.frequency / corner) ** 2) for corner in tuning.CORNERS]
        shares = np.array(tuning.WHITE_SHARES)[:, None]
        return np.concatenate([shares + shape for shape in falling])

    def std(self, left: Array, known: Array) -> Array:
        """(k,) standard deviations averaged over the shapes, by the residual (k,) N m; of each coefficient a part
        `known` (k,) is not in it, as the fit followed it (restricted likelihood)."""
        freedom = np.maximum(1.0 - known, 0.02)
        scale = (left**2 / self.shapes).sum(axis=1) / freedom.sum()
        cost = np.log(scale) * freedom.sum() + np.log(self.shapes) @ freedom
        # Each by how likely it is: which corner holds at low frequencies only few coefficients tell.
        likely = np.exp(-0.5 * (cost - cost.min()))
        power = (likely * scale) @ self.shapes / likely.sum()
        return np.sqrt(power) + tuning.SMALLEST_RESIDUAL
