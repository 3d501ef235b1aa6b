"""Coloured residual of a model beyond the noise of the sensors, learned from the recording itself.

Models of an arm leave more than sensor noise: gear ripple, friction that changes with the place, links that bend. These
errors are not white. Neighbouring rows have similar errors, and a mean over them is less precise than their number
suggests. In each signal

    residual ~ sensor noise + Σ_i v_i exp(-d_i / l_i)

It is a sum of Ornstein-Uhlenbeck processes over time, over the path of the joint (constant at rest), and over its
angle. Their lengths l_i are from a block to a run. What depends on the angle alone is the same whenever the joint is
there: it cancels between passes with and without a load. The variances v_i maximise the likelihood of the rows with all
causes integrated out, signal by signal (restricted maximum likelihood: Patterson and Thompson, Biometrika 58, 1971).
They are found by fixed-point iteration of the score equations (Harville, J. Am. Stat. Assoc. 72, 1977). They are
weighted by the likelihood ratio with and without them, so that a recording of a perfect arm keeps its precision.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array
from palpate.estimation.evidence import once
from palpate.estimation.regression import Cause, SignalNoise

COLOUR_TIMES = (0.03, 0.3, 1.0, 4.0, 30.0)
"""s: correlation times of the residual, from one block to a run. Hardly sensitive."""
COLOUR_PATHS = (0.003, 0.01, 0.1)
"""rad: correlation lengths of the residual over the path of the joint, from gear ripple to a lift. Not sensitive."""
COLOUR_PLACES = (0.01, 0.1)
"""rad: correlation lengths of the residual over the angle of the joint: gear ripple, uneven friction.
Sensitive: mass std ×0.75–0.85 at `measured`."""
COLOUR_START = 0.02
"""N m (1 sigma): start value of each process in the search. Not sensitive."""
COLOUR_ROUNDS = 6
"""number of iterations; each brings a variance nearer to its maximum likelihood. Not sensitive."""
COLOUR_CHANCE = 3.0
"""log likelihood gain by the processes at which they count by half: one for each two or three.
Sensitive: mass std ×1.0–1.1 at `lab`."""
COLOUR_FREEDOM = 4.0
"""least degrees of freedom of the residual's variance. Not sensitive."""
DIFFUSE = 30.0
"""N, N m (1 sigma): largest prior of an unknown while the size of the residual is learned. Not sensitive."""


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Spans:
    """Stretches of motion that k rows average."""

    t: Array  # (k,) s, midpoints
    lasts: Array  # (k,) s, durations
    path: Array  # (k, m) rad, path of each joint until then
    turns: Array  # (k, m) rad, path of each joint within each
    # (k, m) rad, angles at the midpoints; None where the residual is none of the joints'.
    angle: Array | None = None

    @classmethod
    def of(
        cls,
        t: Array,
        path: Array,
        parts: Sequence[NDArray[np.intp] | slice],
        angle: Array | None = None,
    ) -> Spans:
        """Build the stretches from samples at `t` (n,) with the `path` and the `angle` (n, m) of the
        joints, by their rows."""
        return cls(
            np.array([t[rows].mean() for rows in parts]),
            np.array([np.ptp(t[rows]) for rows in parts]),
            np.array([path[rows].mean(axis=0) for rows in parts]),
            np.array([np.ptp(path[rows], axis=0) for rows in parts]),
            None if angle is None else np.array([angle[rows].mean(axis=0) for rows in parts]),
        )

    @classmethod
    def concatenate(cls, parts: Sequence[Spans]) -> Spans:
        """Append all stretches."""
        angles = [one.angle for one in parts if one.angle is not None]
        return cls(
            np.concatenate([one.t for one in parts]),
            np.concatenate([one.lasts for one in parts]),
            np.concatenate([one.path for one in parts]),
            np.concatenate([one.turns for one in parts]),
            np.concatenate(angles) if len(angles) == len(parts) else None,
        )

    @once
    def kernels(self, joint: int) -> Array:
        """Compute the covariances (c, k, k) of the processes in a joint, at unit variance of a single moment."""
        # Processes over time, then over the path of the joint, then over its angle.
        found = [*_time_kernels(self)]
        apart = np.abs(self.path[:, None, joint] - self.path[:, joint])
        found += [_kernel(apart, self.turns[:, joint], far) for far in COLOUR_PATHS]
        if self.angle is not None:
            apart = np.abs(self.angle[:, None, joint] - self.angle[:, joint])
            found += [_kernel(apart, self.turns[:, joint], far) for far in COLOUR_PLACES]
        return np.array(found)


@once
def _time_kernels(spans: Spans) -> Array:
    """Compute the covariances (c, k, k) of the processes over time, which all joints share."""
    apart = np.abs(spans.t[:, None] - spans.t)
    return np.array([_kernel(apart, spans.lasts, time) for time in COLOUR_TIMES])


def _kernel(apart: Array, within: Array, length: float) -> Array:
    """Evaluate exp(-d / l) between rows `apart` (k, k), reduced by the averaging `within` (k,) each."""
    left = np.sqrt(_variance_of_means(within, length))
    return np.exp(-apart / length) * np.outer(left, left)


def _variance_of_means(within: Array, length: float) -> Array:
    """Approximate the variance of means over stretches of length `within`, at unit variance of a single moment."""
    return 1.0 / (1.0 + within / (2.0 * length))


@dataclass(frozen=True, slots=True, eq=False)
class ColouredResidual:
    """Coloured residual of m joints."""

    variances: Array  # (m, c) N² m² of its processes
    freedom: Array  # (m,) degrees of freedom of their size

    def covariance(self, spans: Spans, joint: int) -> Array:
        """Compute the covariance (k, k), N² m², of a joint's means over `spans`."""
        return _mix_kernels(self.variances[joint], spans.kernels(joint))

    def freedom_beside(self, variance: Array, freedom: float, spans: Spans) -> float:
        """Combine the degrees of freedom of the residual and of a noise of the means.

        Source: Welch and Satterthwaite; GUM, annex G.4.

        Args:
            variance: (m,) of the noise.
            freedom: of that variance.
        """
        joints = range(len(self.variances))
        # Share of the residual in the total variance of each joint.
        left = np.array([self._variance(spans, joint).mean() for joint in joints])
        share = left / (left + variance)
        return float(np.mean(1.0 / (share**2 / self.freedom + (1.0 - share) ** 2 / freedom)))

    def _variance(self, spans: Spans, joint: int) -> Array:
        """Compute the variance (k,), N² m², of a joint's means over `spans`: the diagonal of their covariance."""
        times = [_variance_of_means(spans.lasts, time) for time in COLOUR_TIMES]
        lengths = COLOUR_PATHS if spans.angle is None else (*COLOUR_PATHS, *COLOUR_PLACES)
        paths = [_variance_of_means(spans.turns[:, joint], far) for far in lengths]
        return self.variances[joint] @ np.array([*times, *paths])

    @property
    def total(self) -> Array:
        """(m,) N² m², variance of a single moment."""
        return self.variances.sum(axis=1)


def learn_residual(
    causes: Sequence[Cause], noise: SignalNoise, y: Array, spans: Spans
) -> ColouredResidual:
    """Learn the coloured residual of each signal beyond `causes` and `noise` in its rows of `y` (m k,)."""
    design = np.concatenate([cause.columns for cause in causes], axis=1)
    # Integrate the causes out with a diffuse prior, bounded to keep numerical precision.
    prior = np.minimum(np.concatenate([cause.prior for cause in causes]), DIFFUSE)
    ends = np.cumsum([len(root) for root in noise.roots])[:-1]
    parts = zip(noise.roots, np.split(design * prior, ends), np.split(y, ends), strict=True)
    variances: list[Array] = []
    freedom: list[float] = []
    for joint, (root, columns, rows) in enumerate(parts):
        # Known covariance of one signal: its noise, and the causes that act on it.
        used = columns[:, np.abs(columns).max(axis=0) > 0.0]
        own, sure = _likeliest(root @ root.T + used @ used.T, rows, spans.kernels(joint))
        variances.append(own)
        freedom.append(sure)
    return ColouredResidual(np.array(variances), np.array(freedom))


def with_residual(noise: SignalNoise, residual: ColouredResidual, spans: Spans) -> SignalNoise:
    """Add a coloured residual to the noise of each signal."""
    roots: list[Array] = []
    for joint, root in enumerate(noise.roots):
        both = root @ root.T + residual.covariance(spans, joint)
        roots.append(np.linalg.cholesky(both).astype(np.float64))
    # Mean variance of the sensor noise, for the degrees of freedom of the sum.
    own = np.array([float((root * root).sum()) / len(root) for root in noise.roots])
    return SignalNoise(roots, residual.freedom_beside(own, noise.freedom, spans))


def _likeliest(known: Array, rows: Array, kernels: Array) -> tuple[Array, float]:
    """Find the maximum-likelihood variances of the processes, added to a `known` covariance.

    Returns:
        Variances (c,), weighted by the likelihood ratio.
        Degrees of freedom of their size.
    """
    before, _ = _likelihood(known, rows)
    variances = np.full(len(kernels), COLOUR_START**2)
    more = _mix_kernels(variances, kernels)
    for _ in range(COLOUR_ROUNDS):
        # Fixed-point iteration of the score equations.
        _, precision = _inverse(known + more, rows)
        weighted = precision @ rows
        # Scale each variance by the observed over the expected quadratic form.
        share = kernels @ weighted @ weighted
        expected = kernels.reshape(len(kernels), -1) @ precision.ravel()
        variances = variances * share / np.maximum(expected, 1e-300)
        more = _mix_kernels(variances, kernels)
    after, precision = _inverse(known + more, rows)
    # Weight by the likelihood ratio (a logistic function), as the processes may not exist.
    counts = 1.0 / (1.0 + np.exp(min(before + COLOUR_CHANCE - after, 100.0)))
    # Degrees of freedom: twice the Fisher information on the logarithm of the size.
    shown = precision @ more
    freedom = max(float(np.sum(shown * shown.T)), COLOUR_FREEDOM) / max(counts, 1e-3)
    return counts * variances, freedom


def _mix_kernels(variances: Array, kernels: Array) -> Array:
    """Sum the kernels (c, k, k), weighted by their variances (c,)."""
    return (variances @ kernels.reshape(len(kernels), -1)).reshape(kernels.shape[1:])


def _likelihood(covariance: Array, rows: Array) -> tuple[float, Array]:
    """Compute the log likelihood of `rows`, and the lower Cholesky factor of their covariance."""
    from scipy.linalg.lapack import dpotrf, dtrtrs

    root: Array = dpotrf(covariance, lower=True)[0]
    white = dtrtrs(root, rows, lower=True)[0]
    return -0.5 * float(white @ white) - float(np.log(np.diag(root)).sum()), root


def _inverse(covariance: Array, rows: Array) -> tuple[float, Array]:
    """Compute the log likelihood of `rows`, and the inverse of their covariance."""
    from scipy.linalg.lapack import dpotri

    # LAPACK fills the lower triangle only; the rest is zero.
    likelihood, root = _likelihood(covariance, rows)
    inverse: Array = dpotri(root, lower=True)[0]
    inverse += np.tril(inverse, -1).T
    return likelihood, inverse
