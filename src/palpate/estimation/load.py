"""The load on the hand, from a wrench that is never zero.

A component of the sensed wrench, averaged over bin j of segment i (a rest, or a pass along the
path), is modelled as

    y_ij = L_i F (1 + a_ij / g) + M a_ij + c_0 + c_kind(x_ij) + b (t_i - t_0) + e_i + n_ij

    F       the load, which is sought; L_i is 1 in loaded segments and 0 in empty ones
    a, g    vertical acceleration and gravity; M is the arm's own apparent mass
    c       bias: a common one, and one of each kind of segment, a cubic along the path x
    b       drift over time t
    e, n    scatter between segments, and noise within them

It is linear in F, M, c, b and e, which all have normal priors, so that for a given size of the
scatter the posterior of F is normal (Bayesian linear regression, e.g. Bishop, Pattern Recognition
and Machine Learning, section 3.3). The noise is known from the samples; the size of the scatter is
not: it is integrated out on a grid under a half-Cauchy prior, one for rests and one for passes
(Gelman, Prior distributions for variance parameters in hierarchical models, Bayesian Analysis 1,
2006), which gives the result the wide tails that a few groups deserve.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from statistics import NormalDist

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.segments import Segment
from palpate.geometry.pose import Array
from palpate.trace.recording import Hand

FORCE_Z, TORQUE_X, TORQUE_Y = 2, 3, 4
"""Components of a wrench."""


@dataclass(frozen=True, slots=True, eq=False)
class Contrast:
    """A load's component (N or N m) with its posterior standard deviation and central 95 %
    interval."""

    value: float
    std: float
    ci95: tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class _Model:
    """The regression of one component, in N (moments over `tuning.TORQUE_LEVER`).

    Attributes:
        design: (n, p) one row a bin, one column a coefficient: the load first, last one column for
            each segment.
        prior: standard deviations of all coefficients but the segments'.
        y: (n,) readings. noise: (n,) their variance.
    """

    design: Array
    prior: Array
    y: Array
    noise: Array


def fit_load(found: Sequence[Segment], axis: int, gravity: float, hand: Hand) -> Contrast:
    """The load's wrench component `axis` (0..5) from segments.

    Raises:
        ValueError: there is no loaded segment.
    """
    if not any(segment.loaded for segment in found):
        raise ValueError("no recording with the load on the hand")
    # Moments are fitted as the forces that make them, so that one set of priors serves all axes.
    scale = 1.0 if axis <= FORCE_Z else tuning.TORQUE_LEVER
    model = _model(found, axis, gravity, scale)
    unequal = _unequal(found)

    fits: list[tuple[float, float, float]] = []
    for rest, moving in product(tuning.REST_GRID, tuning.PASS_GRID):
        scatter = _scatter(found, unequal, rest, moving)
        value, variance, evidence = _solve(model, np.concatenate([model.prior, scatter]))
        prior = _half_cauchy(rest, hand.force_repeatability / 2)
        prior = prior + _half_cauchy(moving, tuning.PASS_SCATTER)
        fits.append((value, variance, evidence + prior))

    value, variance, log_weight = np.array(fits).T
    weight = np.exp(log_weight - log_weight.max())
    return _mixture(value * scale, np.sqrt(variance) * scale, weight / weight.sum())


def _model(found: Sequence[Segment], axis: int, gravity: float, scale: float) -> _Model:
    """The regression, with the noise of a pass raised by what the model leaves out of it."""
    design, prior = _design(found, axis, gravity, scale)
    # The arm's apparent mass is mostly known: what is expected of it is taken off beforehand.
    apparent = tuning.APPARENT_MASS[0] if axis == FORCE_Z else 0.0
    readings = [segment.mean[:, axis] - apparent * segment.acceleration for segment in found]
    variances = [segment.variance[:, axis] for segment in found]
    y = np.concatenate(readings) / scale
    noise = np.concatenate(variances) / scale**2 + tuning.FLOOR**2

    rough = np.concatenate([prior, np.full(len(found), tuning.ROUGH_SCATTER)])
    misfit = _misfit(found, _residual(_Model(design, rough, y, noise)), noise)
    return _Model(design, prior, y, noise + misfit)


def _design(
    found: Sequence[Segment], axis: int, gravity: float, scale: float
) -> tuple[Array, Array]:
    """The regression's columns, and the prior standard deviations of all but the segments'.

    In this order: load, apparent mass, common bias, drift; a polynomial along the path for each
    kind; one column for each segment.
    """
    kinds = sorted({segment.kind for segment in found})
    t0 = float(np.mean([segment.t for segment in found]))
    rows: list[list[float]] = []
    for own, segment in zip(np.eye(len(found)), found, strict=True):
        for x, a in zip(segment.path, segment.acceleration, strict=True):
            load = 1.0 + a / gravity if segment.loaded else 0.0
            bias = _along_path(x, kinds.index(segment.kind), len(kinds))
            rows.append([load, a, 1.0, segment.t - t0, *bias, *own])

    inertia = tuning.APPARENT_MASS[1] * (1.0 if axis == FORCE_Z else tuning.CROSS_INERTIA)
    prior = [tuning.LOAD_PRIOR / scale, inertia, tuning.FORCE_BIAS, tuning.DRIFT]
    prior += [tuning.KIND_BIAS] * (len(kinds) * (tuning.DEGREE + 1))
    return np.array(rows, dtype=float), np.array(prior)


def _along_path(x: float, kind: int, kinds: int) -> Array:
    """A row of the kinds' polynomials: powers of `x` in the columns of `kind`, else zeros."""
    powers = np.zeros((kinds, tuning.DEGREE + 1))
    powers[kind] = [x**power for power in range(tuning.DEGREE + 1)]
    return powers.ravel()


def _scatter(
    found: Sequence[Segment], unequal: Sequence[float], rest: float, moving: float
) -> Array:
    """(segments,) N: scatter of each segment, more for a pass at an unusual speed."""
    sizes = [rest if segment.at_rest else moving for segment in found]
    return np.hypot(sizes, unequal)


def _unequal(found: Sequence[Segment]) -> list[float]:
    """N: scatter of each pass for moving at another speed than the others of its kind."""
    speeds: dict[str, list[float]] = {}
    for segment in found:
        speeds.setdefault(segment.kind, []).append(float(segment.speed2.mean()))
    usual = {kind: np.mean(speed2) for kind, speed2 in speeds.items()}

    extra: list[float] = []
    for segment in found:
        apart = abs(float(segment.speed2.mean() - usual[segment.kind]))
        extra.append(0.0 if segment.at_rest else tuning.CENTRIFUGAL * apart)
    return extra


def _half_cauchy(sigma: float, scale: float) -> float:
    """Log of the half-Cauchy density, up to a constant, times sigma: the grid is uniform in
    log(sigma)."""
    return float(np.log(sigma) - np.log1p((sigma / scale) ** 2))


def _normal_equations(model: _Model, prior: Array) -> tuple[Array, Array]:
    """Posterior information Xᵀ N⁻¹ X + P⁻² and projection Xᵀ N⁻¹ y."""
    information = (model.design.T / model.noise) @ model.design + np.diag(prior**-2)
    return information, model.design.T @ (model.y / model.noise)


def _solve(model: _Model, prior: Array) -> tuple[float, float, float]:
    """Posterior mean and variance of the first coefficient, and the log evidence.

    With information A, prior deviations p and posterior mean m, the log evidence is
    -(yᵀN⁻¹y - mᵀA m)/2 - Σ log p - log|A|/2, up to what does not depend on p (Bishop, section
    3.5.1).
    """
    information, projected = _normal_equations(model, prior)
    covariance = np.linalg.inv(information)
    mean = covariance @ projected
    misfit = float(model.y @ (model.y / model.noise) - projected @ mean)
    log_det = float(2.0 * np.log(prior).sum() + np.linalg.slogdet(information)[1])
    return float(mean[0]), float(covariance[0, 0]), -0.5 * (misfit + log_det)


def _residual(model: _Model) -> Array:
    """(n,) what a fit leaves of each row."""
    information, projected = _normal_equations(model, model.prior)
    return model.y - model.design @ np.linalg.solve(information, projected)


def _misfit(found: Sequence[Segment], residual: Array, noise: Array) -> Array:
    """(n,) variance to add to each row: what the model leaves of each pass beyond its noise, as
    correlated over bins."""
    extra = np.zeros_like(residual)
    for segment, rows in _rows(found):
        if segment.at_rest:
            continue
        beyond = float((residual[rows] ** 2 - noise[rows]).mean())
        extra[rows] = tuning.CORRELATED_BINS * max(0.0, beyond)
    return extra


def _rows(found: Sequence[Segment]) -> Iterator[tuple[Segment, slice]]:
    """Each segment with its rows of the regression."""
    first = 0
    for segment in found:
        rows = slice(first, first + len(segment.path))
        first = rows.stop
        yield segment, rows


def _mixture(means: Array, stds: Array, weights: Array) -> Contrast:
    """Moments and quantiles of a mixture of normals."""
    mean = float(weights @ means)
    std = float(np.sqrt(weights @ (stds**2 + (means - mean) ** 2)))
    parts: list[tuple[float, NormalDist]] = []
    for weight, middle, width in zip(weights, means, stds, strict=True):
        if weight > 1e-6:
            parts.append((weight, NormalDist(middle, width)))
    return Contrast(mean, std, (_quantile(parts, 0.025), _quantile(parts, 0.975)))


def _quantile(parts: Sequence[tuple[float, NormalDist]], p: float) -> float:
    """The point below which the mixture has `p` of its mass, by bisection."""
    low = min(part.mean - 12 * part.stdev for _, part in parts)
    high = max(part.mean + 12 * part.stdev for _, part in parts)
    for _ in range(60):
        middle = (low + high) / 2
        below = sum(weight * part.cdf(middle) for weight, part in parts)
        if below < p:
            low = middle
        else:
            high = middle
    return (low + high) / 2
