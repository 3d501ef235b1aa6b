"""Coloured residual: what a model leaves beyond the noise of the sensors, learned from the recording itself.

Models of an arm leave more than sensor noise: ripple of gears, friction that changes with the place, links that
bend. That is not white: neighbouring rows err alike, and a mean over them is worse than their number promises.
In each signal

    residual ~ sensor noise + Σ_i v_i exp(-d_i / l_i)

a sum of Ornstein-Uhlenbeck processes over time and over the path that the joint has turned (at rest it stays as it
is), with lengths l_i from a block to a run. The variances v_i maximise the likelihood of the rows with all causes
integrated out (restricted maximum likelihood: Patterson and Thompson, Biometrika 58, 1971; by the updates of Zhou
et al., MM algorithms for variance components models, J. Comput. Graph. Stat. 28, 2019), signal by signal. They count
by how much likelier they make the rows, so that a recording of a perfect arm is not punished.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.regression import Cause, SignalNoise
from palpate.geometry.pose import Array


def coloured(
    causes: Sequence[Cause], noise: SignalNoise, y: Array, kernels: Sequence[Array]
) -> SignalNoise:
    """Noise with a coloured residual of each signal, learned from its rows of `y` (n,); `kernels` (c, k, k): of each
    signal the processes that may be in it, at unit variance."""
    design = np.concatenate([cause.columns for cause in causes], axis=1)
    # Diffuse, but not so much that nothing is left of the digits.
    prior = np.minimum(np.concatenate([cause.prior for cause in causes]), tuning.DIFFUSE)
    ends = np.cumsum([len(root) for root in noise.roots])[:-1]
    parts = zip(
        noise.roots, np.split(design * prior, ends), np.split(y, ends), kernels, strict=True
    )
    roots: list[Array] = []
    freedom: list[float] = []
    for root, columns, rows, own in parts:
        used = columns[:, np.abs(columns).max(axis=0) > 0.0]
        sensors = root @ root.T
        more, sure = _likeliest(sensors + used @ used.T, rows, own)
        roots.append(np.linalg.cholesky(sensors + more).astype(np.float64))
        freedom.append(min(sure, noise.freedom))
    return SignalNoise(roots, float(np.mean(freedom)))


def _likeliest(known: Array, rows: Array, kernels: Array) -> tuple[Array, float]:
    """Covariance of the likeliest processes beside a `known` one, and the degrees of freedom of its size."""
    before, _ = _inverse(known, rows)
    variances = np.full(len(kernels), tuning.COLOUR_START**2)
    more = _mixed(variances, kernels)
    for _ in range(tuning.COLOUR_ROUNDS):
        _, precision = _inverse(known + more, rows)
        weighted = precision @ rows
        # Each by its share in what is left, over what it is expected to leave.
        share = kernels @ weighted @ weighted
        expected = np.einsum("ij,cij->c", precision, kernels)
        variances = variances * np.sqrt(share / np.maximum(expected, 1e-300))
        more = _mixed(variances, kernels)
    after, precision = _inverse(known + more, rows)
    counts = 1.0 / (1.0 + np.exp(min(before + tuning.COLOUR_CHANCE - after, 100.0)))
    # Twice the information on the logarithm of its size.
    shown = precision @ more
    freedom = max(float(np.sum(shown * shown.T)), tuning.COLOUR_FREEDOM) / max(counts, 1e-3)
    return counts * more, freedom


def _mixed(variances: Array, kernels: Array) -> Array:
    return np.einsum("c,cij->ij", variances, kernels)


def _inverse(covariance: Array, rows: Array) -> tuple[float, Array]:
    """Logarithm of the likelihood of `rows`, and the inverse of their covariance."""
    from scipy.linalg.lapack import dpotrf, dpotri

    root = dpotrf(covariance, lower=True)[0]
    lower = np.tril(dpotri(root, lower=True)[0])
    inverse: Array = lower + np.tril(lower, -1).T
    return -0.5 * float(rows @ inverse @ rows) - float(np.log(np.diag(root)).sum()), inverse
