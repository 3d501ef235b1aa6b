"""Coloured residual: what a model leaves beyond the noise of the sensors, learned from the recording itself.

Models of an arm leave more than sensor noise: ripple of gears, friction that changes with the place, links that
bend. That is not white: neighbouring rows err alike, and a mean over them is worse than their number promises.
In each signal

    residual ~ sensor noise + Σ_i v_i exp(-d_i / l_i)

a sum of Ornstein-Uhlenbeck processes over time and over the path that the joint has turned (at rest it stays as it
is), with lengths l_i from a block to a run. The variances v_i maximise the likelihood of the rows with all causes
integrated out (restricted maximum likelihood: Patterson and Thompson, Biometrika 58, 1971; by fixed-point iteration of
its score equations: Harville, J. Am. Stat. Assoc. 72, 1977), signal by signal. They count by how much likelier they
make the rows, so that a recording of a perfect arm is not punished.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array
from palpate.estimation.regression import Cause, SignalNoise

COLOUR_TIMES = (0.03, 0.3, 1.0, 4.0, 30.0)
"""s over which what a model leaves stays alike: from one block to a run. Sensitive: hardly."""
COLOUR_PATHS = (0.003, 0.01, 0.1)
"""rad over which it does as the joint turns: of gears' ripple and of a lift. Sensitive: no."""
COLOUR_START = 0.02
"""N m (1 sigma) of each process, from which the recording's own is sought. Sensitive: no."""
COLOUR_ROUNDS = 6
"""rounds of that; each brings a variance nearer to its likeliest. Sensitive: no."""
COLOUR_CHANCE = 3.0
"""logarithm of how much likelier the rows have to be with the processes than without, to count by half: one for each
two of the seven. Sensitive: mass std ×1.0–1.1 at `lab`."""
COLOUR_FREEDOM = 4.0
"""degrees of freedom that its variance has at least. Sensitive: no."""
DIFFUSE = 30.0
"""N, N m (1 sigma) of an unknown with no prior, as the size of a residual is learned. Sensitive: no."""


@dataclass(frozen=True, slots=True, eq=False)
class Spans:
    """Stretches of motion of which k rows are means.

    Attributes:
        t, lasts: (k,) s, their middles and lengths.
        path, turns: (k, m) rad that each joint has turned until then, and within each.
    """

    t: Array
    lasts: Array
    path: Array
    turns: Array

    @classmethod
    def of(cls, t: Array, path: Array, parts: Sequence[NDArray[np.intp] | slice]) -> Spans:
        """Stretches of samples at `t` (n,) with the `path` (n, m) of the joints, by their rows."""
        return cls(
            np.array([t[rows].mean() for rows in parts]),
            np.array([np.ptp(t[rows]) for rows in parts]),
            np.array([path[rows].mean(axis=0) for rows in parts]),
            np.array([np.ptp(path[rows], axis=0) for rows in parts]),
        )

    @classmethod
    def concatenate(cls, parts: Sequence[Spans]) -> Spans:
        """All stretches, one after the other."""
        return cls(
            *(np.concatenate([getattr(one, name) for one in parts]) for name in cls.__slots__)
        )

    def kernels(self, joint: int) -> Array:
        """(c, k, k) covariances of the processes in a joint, at unit variance of a moment."""
        apart = np.abs(self.t[:, None] - self.t)
        found = [_kernel(apart, self.lasts, time) for time in COLOUR_TIMES]
        apart = np.abs(self.path[:, None, joint] - self.path[:, joint])
        found += [_kernel(apart, self.turns[:, joint], far) for far in COLOUR_PATHS]
        return np.array(found)


def _kernel(apart: Array, within: Array, length: float) -> Array:
    """exp(-d / l) between rows `apart` (k, k), less what averages out `within` (k,) each."""
    left = np.sqrt(_variance_of_means(within, length))
    return np.exp(-apart / length) * np.outer(left, left)


def _variance_of_means(within: Array, length: float) -> Array:
    """Variance of means over stretches that turn `within`, at unit variance of a moment."""
    return 1.0 / (1.0 + within / (2.0 * length))


@dataclass(frozen=True, slots=True, eq=False)
class ColouredResidual:
    """Coloured residual of m joints: `variances` (m, c) N² m² of its processes, with `freedom` (m,) degrees of freedom
    of their size."""

    variances: Array
    freedom: Array

    def covariance(self, spans: Spans, joint: int) -> Array:
        """(k, k) N² m² of a joint's means over `spans`."""
        return _mix_kernels(self.variances[joint], spans.kernels(joint))

    def freedom_beside(self, variance: Array, freedom: float, spans: Spans) -> float:
        """Degrees of freedom of both, beside a noise of the means with `variance` (m,) and its `freedom` (Welch and
        Satterthwaite; GUM, annex G.4)."""
        joints = range(len(self.variances))
        left = np.array([self._variance(spans, joint).mean() for joint in joints])
        share = left / (left + variance)
        return float(np.mean(1.0 / (share**2 / self.freedom + (1.0 - share) ** 2 / freedom)))

    def _variance(self, spans: Spans, joint: int) -> Array:
        """(k,) N² m² of a joint's means over `spans`: the diagonal of their covariance."""
        times = [_variance_of_means(spans.lasts, time) for time in COLOUR_TIMES]
        paths = [_variance_of_means(spans.turns[:, joint], far) for far in COLOUR_PATHS]
        return self.variances[joint] @ np.array([*times, *paths])

    @property
    def total(self) -> Array:
        """(m,) N² m² of a moment."""
        return self.variances.sum(axis=1)


def learn_residual(
    causes: Sequence[Cause], noise: SignalNoise, y: Array, spans: Spans
) -> ColouredResidual:
    """Coloured residual of each signal that `causes` and `noise` leave of its rows of `y` (m k,)."""
    design = np.concatenate([cause.columns for cause in causes], axis=1)
    # Diffuse, but not so much that nothing is left of the digits.
    prior = np.minimum(np.concatenate([cause.prior for cause in causes]), DIFFUSE)
    ends = np.cumsum([len(root) for root in noise.roots])[:-1]
    parts = zip(noise.roots, np.split(design * prior, ends), np.split(y, ends), strict=True)
    variances: list[Array] = []
    freedom: list[float] = []
    for joint, (root, columns, rows) in enumerate(parts):
        used = columns[:, np.abs(columns).max(axis=0) > 0.0]
        own, sure = _likeliest(root @ root.T + used @ used.T, rows, spans.kernels(joint))
        variances.append(own)
        freedom.append(sure)
    return ColouredResidual(np.array(variances), np.array(freedom))


def with_residual(noise: SignalNoise, residual: ColouredResidual, spans: Spans) -> SignalNoise:
    """Noise with a coloured residual in each signal."""
    roots: list[Array] = []
    for joint, root in enumerate(noise.roots):
        both = root @ root.T + residual.covariance(spans, joint)
        roots.append(np.linalg.cholesky(both).astype(np.float64))
    own = np.array([float((root * root).sum()) / len(root) for root in noise.roots])
    return SignalNoise(roots, residual.freedom_beside(own, noise.freedom, spans))


def _likeliest(known: Array, rows: Array, kernels: Array) -> tuple[Array, float]:
    """Variances of the likeliest processes beside a `known` covariance, and the degrees of freedom of their size."""
    before, _ = _inverse(known, rows)
    variances = np.full(len(kernels), COLOUR_START**2)
    more = _mix_kernels(variances, kernels)
    for _ in range(COLOUR_ROUNDS):
        _, precision = _inverse(known + more, rows)
        weighted = precision @ rows
        # Each by its share in what is left, over what it is expected to leave.
        share = kernels @ weighted @ weighted
        expected = kernels.reshape(len(kernels), -1) @ precision.ravel()
        variances = variances * share / np.maximum(expected, 1e-300)
        more = _mix_kernels(variances, kernels)
    after, precision = _inverse(known + more, rows)
    counts = 1.0 / (1.0 + np.exp(min(before + COLOUR_CHANCE - after, 100.0)))
    # Twice the information on the logarithm of its size.
    shown = precision @ more
    freedom = max(float(np.sum(shown * shown.T)), COLOUR_FREEDOM) / max(counts, 1e-3)
    return counts * variances, freedom


def _mix_kernels(variances: Array, kernels: Array) -> Array:
    return (variances @ kernels.reshape(len(kernels), -1)).reshape(kernels.shape[1:])


def _inverse(covariance: Array, rows: Array) -> tuple[float, Array]:
    """Logarithm of the likelihood of `rows`, and the inverse of their covariance."""
    from scipy.linalg.lapack import dpotrf, dpotri

    # Both are zero above the diagonal.
    root = dpotrf(covariance, lower=True)[0]
    inverse: Array = dpotri(root, lower=True)[0]
    inverse += inverse.T
    inverse[np.diag_indices_from(inverse)] *= 0.5
    return -0.5 * float(rows @ inverse @ rows) - float(np.log(np.diag(root)).sum()), inverse
