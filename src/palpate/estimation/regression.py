"""Linear-Gaussian regression: causes + noise + y → posterior.

    y = Σ_c X_c x_c + n        x_c ~ N(0, s² P_c²)        n ~ N(0, Σ)

A *cause* c has columns X_c (effects of its unknowns on the rows y) and prior standard deviations P_c. The scales s of
some causes are learned from the recording. *Noise* whitens rows to unit variance. The posterior of all unknowns has a
closed form. It is averaged over the scales by their evidence.

Sources: C. Bishop, Pattern Recognition and Machine Learning, sections 3.3 and 3.5; Hoeting et al., Statistical Science
14, 1999.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array
from palpate.estimation.estimate import FitTest, Shared, chi_squared

COUNTED = 1e-4
"""probability above which a combination of hyperpriors enters the average. Not sensitive."""


@dataclass(frozen=True, slots=True, eq=False)
class Cause:
    """Named cause of the observed rows, with k unknowns."""

    name: str  # unique among the causes of a fit
    columns: Array  # (n, k) effect of a unit of each unknown on the n rows
    prior: Array  # (k,) standard deviations of the unknowns, about 0
    # `arm` or `scene` where other runs share its errors, else None.
    of: Literal["arm", "scene"] | None = None
    # (k,) names of shared unknowns; empty: the name of the cause and a number.
    labels: tuple[str, ...] = ()

    @classmethod
    def build(
        cls,
        name: str,
        columns: Array,
        prior: float | Sequence[float] | Array,
        of: Literal["arm", "scene"] | None = None,
        labels: tuple[str, ...] = (),
    ) -> Cause:
        """Build a cause of `columns` (..., k), whose first axes count the rows; one prior may serve all unknowns."""
        *rows, count = columns.shape
        deviations: Array = np.broadcast_to(np.asarray(prior, np.float64), (count,)).copy()
        return cls(name, columns.reshape(math.prod(rows), count), deviations, of, labels)


@dataclass(frozen=True, slots=True, eq=False)
class PriorScale:
    """Hyperprior of the named causes: a common scale of their prior deviations."""

    causes: tuple[str, ...]  # names
    factors: Sequence[float | Array]  # possible scales, a number for all unknowns or an array
    chance: Sequence[float]  # prior probability of each factor


class RowNoise(Protocol):
    """Noise of n rows."""

    @property
    def freedom(self) -> float:
        """Degrees of freedom of its variance."""
        ...

    @property
    def volume(self) -> float:
        """Half the log determinant of its covariance."""
        ...

    def white(self, rows: Array) -> Array:
        """Bring rows (n, p) to unit variance."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class SignalNoise:
    """Noise of rows ordered by signal, independent between signals."""

    roots: Sequence[Array]  # Cholesky factor (k, k), lower, of the covariance of each signal
    freedom: float  # degrees of freedom of the variance

    @property
    def volume(self) -> float:
        """Half the log determinant of its covariance."""
        return float(sum(np.log(np.diag(root)).sum() for root in self.roots))

    def white(self, rows: Array) -> Array:
        """Bring rows (n, p) to unit variance."""
        ends = np.cumsum([len(root) for root in self.roots])
        parts = np.split(rows, ends[:-1])
        pairs = zip(self.roots, parts, strict=True)
        return np.concatenate([whiten(root, part) for root, part in pairs])


@dataclass(frozen=True, slots=True, eq=False)
class Projected:
    """Noise with further unknowns without a prior, projected out of all rows.

    Source: Frisch and Waugh, Econometrica 1, 1933.
    """

    noise: RowNoise  # of the rows
    basis: Array  # (n, k) orthonormal basis of the whitened columns of these unknowns

    @classmethod
    def of(cls, noise: RowNoise, columns: Array) -> Projected:
        """Add the unknowns of `columns` (n, k) to the noise."""
        return cls(noise, np.linalg.qr(noise.white(columns))[0])

    @property
    def freedom(self) -> float:
        """Degrees of freedom of its variance."""
        return self.noise.freedom

    @property
    def volume(self) -> float:
        """Half the log determinant of the covariance of `noise`."""
        return self.noise.volume

    def white(self, rows: Array) -> Array:
        """Bring rows (n, p) to unit variance."""
        found = self.noise.white(rows)
        return found - self.basis @ (self.basis.T @ found)


def whiten(root: Array, rows: Array) -> Array:
    """Solve L x = rows (n, p) for a lower triangular `root` L (n, n)."""
    from scipy.linalg.lapack import dtrtrs

    # LAPACK stores by columns and reads the C-ordered root as its transpose.
    return dtrtrs(root.T, rows, lower=False, trans=True)[0]


def fit(
    causes: Sequence[Cause],
    noise: RowNoise,
    y: Array,
    scales: Sequence[PriorScale] = (),
    first: int | None = None,
) -> Posterior:
    """Fit the unknowns of all `causes` to rows `y` (n,).

    Args:
        scales: hyperpriors of the causes.
        first: number of rows of the covariance to compute; all by default.
    """
    model = whitened_model(causes, noise, y, scales)
    return Posterior(tuple(causes), noise, model, *model.solve(first))


def whitened_model(
    causes: Sequence[Cause], noise: RowNoise, y: Array, scales: Sequence[PriorScale]
) -> LinearModel:
    """Build the linear model of rows `y` (n,) in units of the noise."""
    design = noise.white(np.concatenate([cause.columns for cause in causes], axis=1))
    prior = np.concatenate([cause.prior for cause in causes])
    # Unknowns of each hyperprior.
    places, every = place_unknowns(causes), np.arange(len(prior), dtype=np.intp)
    hyperpriors: list[tuple[NDArray[np.intp], PriorScale]] = []
    for scale in scales:
        which = np.concatenate([every[places[name]] for name in scale.causes])
        hyperpriors.append((which, scale))
    return LinearModel(design, noise.white(y), prior, noise.freedom, tuple(hyperpriors))


def place_unknowns(causes: Sequence[Cause]) -> dict[str, slice]:
    """Map the name of each cause to the slice of its unknowns."""
    ends = np.cumsum([0, *(len(cause.prior) for cause in causes)]).tolist()
    pairs = zip(causes, ends[:-1], ends[1:], strict=True)
    return {cause.name: slice(first, last) for cause, first, last in pairs}


@dataclass(frozen=True, slots=True, eq=False)
class Posterior:
    """Normal posterior of the p unknowns of all causes."""

    causes: tuple[Cause, ...]  # of the fit
    noise: RowNoise  # of the fit
    model: LinearModel  # whitened
    mean: Array  # (p,) of all unknowns, cause after cause
    covariance: Array  # (p, p) of the unknowns, or its first rows
    # (p, p) effects on the estimates of one prior deviation of each unknown, or the first rows.
    errors: Array
    density: float  # log probability density of the whitened rows

    def __getitem__(self, name: str) -> tuple[Array, Array]:
        """Mean (k,) and covariance (k, k) of the unknowns of a cause."""
        here = place_unknowns(self.causes)[name]
        return self.mean[here], self.covariance[here, here]

    @property
    def residual(self) -> Array:
        """(n,) residuals of the rows, in units of the noise."""
        return self.model.y - self.model.design @ self.mean

    @property
    def leverage(self) -> Array:
        """(n,) diagonal of the hat matrix: the share of each row's noise that the fit follows."""
        return ((self.model.design @ self.covariance) * self.model.design).sum(axis=1)

    @property
    def evidence(self) -> float:
        """Log probability density of the rows, up to a constant that depends on their number."""
        return self.density - self.noise.volume

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the noise."""
        return self.noise.freedom

    def shared(self, of: str | slice) -> tuple[Shared, ...]:
        """List the errors of the unknowns `of` a cause, or of a slice of them, that other runs share.

        They are the effects of one standard deviation of each unknown of the arm or the scene.
        """
        rows = place_unknowns(self.causes)[of] if isinstance(of, str) else of
        found: list[Shared] = []
        for cause in self.causes:
            if cause.of is None:
                continue
            numbered = tuple(f"{cause.name} {i + 1}" for i in range(len(cause.prior)))
            labels = cause.labels or numbered
            effects = self.effects(cause.name)[rows].T.tolist()
            for label, effect in zip(labels, effects, strict=True):
                found.append(Shared(label, cause.of, tuple(effect)))
        return tuple(found)

    def effects(self, name: str) -> Array:
        """Effects (p, k) on all estimates, or the first, of one prior deviation of each unknown of a cause.

        The sum of their squares over all unknowns is at most the variance of the estimate.
        """
        return self.errors[:, place_unknowns(self.causes)[name]]

    def test(
        self, cause: Cause, tolerated: Array, finding: str | Callable[[Array], str]
    ) -> FitTest:
        """Wald test for a further cause.

        Args:
            tolerated: (k,) 1 sigma, size of its unknowns that does not matter.
            finding: message of a failure; a function gets the mean (k + p,) of its unknowns and of
                all others.
        """
        count = len(cause.prior)
        # Extend the model by the cause, and solve for its unknowns.
        wider = self.model.extend(self.noise.white(cause.columns), cause.prior)
        mean, covariance, *_ = wider.solve(count)
        # Wald statistic, with the tolerated size as a further variance.
        spread = covariance[:, :count] + np.diag(tolerated**2)
        statistic = float(mean[:count] @ np.linalg.solve(spread, mean[:count]))
        text = finding if isinstance(finding, str) else finding(mean)
        return chi_squared(cause.name, statistic, count, text, self.freedom)

    def each_alone(self, columns: Array, prior: float) -> tuple[Array, Array]:
        """Posterior means and variances (k,) of further unknowns with `columns` (n, k), each added alone."""
        return self.model.each_alone(self.noise.white(columns), prior)


class _Information(NamedTuple):
    """Information matrix of p unknowns, I + P G P, in units of their prior deviations.

    Unknowns that are known (deviation 0) thus need no inverse of zero.
    """

    prior: Array  # (p,) P, prior deviations
    root: Array  # (p, p) Cholesky factor

    @classmethod
    def of(cls, prior: Array, gram: Array) -> _Information:
        """Build it for rows whose columns have the inner products `gram` G (p, p)."""
        from scipy.linalg.lapack import dpotrf

        information = prior[:, None] * gram * prior
        information.flat[:: len(prior) + 1] += 1.0
        # LAPACK stores by columns; the matrix is symmetric.
        return cls(prior, dpotrf(information.T, lower=True)[0])

    @property
    def volume(self) -> float:
        """Half the log determinant, in units of the prior deviations."""
        return float(np.log(np.diag(self.root)).sum())

    def solve(self, columns: Array) -> Array:
        """Multiply the covariance of the unknowns by `columns` (p, k)."""
        return self.per_deviation(self.prior[:, None] * columns)

    def per_deviation(self, columns: Array) -> Array:
        """Multiply the covariance, divided by the prior deviations on its right side, by `columns` (p, k)."""
        from scipy.linalg.lapack import dpotrs

        if not columns.size:
            return np.zeros_like(columns)
        return dpotrs(self.root, columns, lower=True)[0] * self.prior[:, None]


class _Solved(NamedTuple):
    """Posterior of the unknowns with a scale, for one choice of the scales."""

    information: _Information
    mean: Array
    evidence: float


@dataclass(frozen=True, slots=True, eq=False)
class _Reduced:
    """Normal equations of the v unknowns with a scale; the f others are integrated out (Schur complement).

    Given the former, x, the others have the mean `offset` - `slope` x for all scales.
    """

    scaled: NDArray[np.intp]  # (v,) indices of the unknowns with a scale
    others: NDArray[np.intp]  # (f,) indices of the others
    information: _Information  # of the others, given the scaled ones
    offset: Array  # (f,) see above
    slope: Array  # (f, v) see above
    gram: Array  # (v, v) Schur complement of the inner products of the columns
    projected: Array  # (v,) inner products of the columns with `y`, less the part of the others
    evidence: float  # of the others

    @classmethod
    def of(cls, model: LinearModel) -> _Reduced:
        """Integrate out the unknowns of a model that have no hyperprior."""
        # Split the unknowns by whether they have a hyperprior.
        every = np.arange(len(model.prior), dtype=np.intp)
        chosen = np.isin(
            every, np.concatenate([every[:0], *(which for which, _ in model.hyperpriors)])
        )
        scaled, others = every[chosen], every[~chosen]
        # Normal equations, and the Schur complement of the others.
        projected, gram = model.design.T @ model.y, model.design.T @ model.design
        across = gram[np.ix_(others, scaled)]
        information = _Information.of(model.prior[others], gram[np.ix_(others, others)])
        offset = information.solve(projected[others, None])[:, 0]
        slope = information.solve(across)
        return cls(
            scaled,
            others,
            information,
            offset,
            slope,
            gram[np.ix_(scaled, scaled)] - across.T @ slope,
            projected[scaled] - across.T @ offset,
            0.5 * float(projected[others] @ offset) - information.volume,
        )

    def all_of(
        self, mean: Array, covariance: Array, within: Array, first: int
    ) -> tuple[Array, Array, Array]:
        """Assemble mean (p,), covariance (first, p) and effects of one prior deviation (first, p) of all unknowns.

        Args:
            mean: (v,) of the unknowns with a scale.
            covariance: (v, v) of these, with the spread of the means.
            within: (2, v, v) their covariance without that spread, and the same over their prior
                deviations.
            first: number of rows.
        """
        count = len(self.scaled) + len(self.others)
        # All unknowns follow linearly from the scaled ones: x for these, offset - slope x for the others.
        follow = np.empty((count, len(mean)))
        follow[self.scaled], follow[self.others] = np.eye(len(mean)), -self.slope
        means = follow @ mean
        means[self.others] += self.offset
        covariances: Array = follow[:first] @ covariance @ follow.T
        # Error of the estimates: -covariance P⁻² x, with coefficients x of prior deviations P.
        errors = np.empty_like(covariances)
        deviation = np.where(self.information.prior > 0.0, self.information.prior, np.inf)
        errors[:, self.scaled] = -follow[:first] @ within[1]
        errors[:, self.others] = follow[:first] @ within[0] @ self.slope.T / deviation
        # The others have a covariance of their own, given the scaled ones.
        head = self.others[self.others < first]
        own = self.information.solve(np.eye(len(self.others), len(head)))
        covariances[np.ix_(head, self.others)] += own.T
        errors[np.ix_(head, self.others)] -= own.T / deviation
        return means, covariances, errors


@dataclass(frozen=True, slots=True, eq=False)
class LinearModel:
    """Linear model y = design · x + n in rows of unit variance."""

    design: Array  # (n, p)
    y: Array  # (n,)
    prior: Array  # (p,) prior deviations of the coefficients x
    freedom: float  # degrees of freedom of the noise variance
    hyperpriors: tuple[
        tuple[NDArray[np.intp], PriorScale], ...
    ]  # indices of coefficients, and scale

    def solve(self, first: int | None = None) -> tuple[Array, Array, Array, float]:
        """Compute the posterior, averaged over the hyperpriors.

        Source (Bayesian model averaging): Hoeting et al., Statistical Science 14, 1999.

        Returns:
            Mean (p,).
            Covariance (first, p); all p rows by default.
            Effects (first, p) on the estimates of one prior deviation of each coefficient, at the
            scale of each combination.
            Log probability density of `y`, up to a constant.
        """
        # Posterior and evidence for each combination of the scales.
        reduced = _Reduced.of(self)
        every = self._every(reduced)
        evidence = np.array([each.evidence for each in every])
        # Weights in proportion to the evidence, shifted by the maximum against overflow.
        weights = np.exp(evidence - evidence.max())
        density = float(evidence.max() + np.log(weights.sum()) - 0.5 * self.y @ self.y)
        weights /= weights.sum()
        # Leave out combinations of negligible weight.
        counted = np.flatnonzero(weights > COUNTED)
        weights = weights[counted] / weights[counted].sum()
        solved = [every[i] for i in counted.tolist()]
        # Mean, and spread of the means between the combinations.
        means = np.array([each.mean for each in solved])
        mean: Array = weights @ means
        covariance: Array = (means - mean).T @ (weights[:, None] * (means - mean))
        # Covariance within each combination. The spread between them is no error that one scale explains.
        within = np.zeros((2, *covariance.shape))
        for weight, each in zip(weights, solved, strict=True):
            carried = each.information.per_deviation(np.eye(len(mean)))
            within += weight * np.array([carried * each.information.prior, carried])
        count = len(self.prior) if first is None else first
        return *reduced.all_of(mean, covariance + within[0], within, count), density

    def _every(self, reduced: _Reduced) -> Sequence[_Solved]:
        """Solve for each combination of the hyperpriors' factors."""
        place = np.searchsorted(reduced.scaled, np.arange(len(self.prior)))
        columns = [place[which] for which, _ in self.hyperpriors]
        choices = product(*(range(len(scale.factors)) for _, scale in self.hyperpriors))
        return [self._solve(choice, columns, reduced) for choice in choices]

    def _solve(
        self, choice: tuple[int, ...], columns: Sequence[NDArray[np.intp]], reduced: _Reduced
    ) -> _Solved:
        """Solve with the chosen scale factors of `columns`.

        The evidence is the log probability of the choice and of `y`, up to a constant common to all
        choices (Bishop, Pattern Recognition and Machine Learning, section 3.5.1).
        """
        # Scale the prior deviations, and add the log prior probability of the choice.
        prior, chance = self.prior[reduced.scaled], reduced.evidence
        for (_, each), here, i in zip(self.hyperpriors, columns, choice, strict=True):
            prior[here] *= each.factors[i]
            chance += float(np.log(each.chance[i]))
        information = _Information.of(prior, reduced.gram)
        mean = information.solve(reduced.projected[:, None])[:, 0]
        evidence = chance + 0.5 * float(mean @ reduced.projected) - information.volume
        return _Solved(information, mean, evidence)

    def each_alone(self, columns: Array, prior: float) -> tuple[Array, Array]:
        """Posterior means and variances (k,) of the coefficients of `columns` (n, k), each added alone."""
        reduced = _Reduced.of(self)
        across = self.design.T @ columns
        others = across[reduced.others]
        # Subtract the part that the unknowns without a hyperprior explain.
        squares = (columns**2).sum(axis=0) - (others * reduced.information.solve(others)).sum(
            axis=0
        )
        projected = columns.T @ self.y - others.T @ reduced.offset
        shared = across[reduced.scaled] - reduced.slope.T @ others
        means: list[Array] = []
        variances: list[Array] = []
        evidence: list[Array] = []
        for each in self._every(reduced):
            # Subtract the part that the scaled unknowns explain, and solve for the one coefficient.
            known = (shared * each.information.solve(shared)).sum(axis=0)
            variance = 1.0 / (np.maximum(squares - known, 0.0) + prior**-2)
            mean = variance * (projected - shared.T @ each.mean)
            means.append(mean)
            variances.append(variance)
            evidence.append(each.evidence + 0.5 * (mean**2 / variance + np.log(variance)))
        # Average over the combinations by the evidence that each coefficient gives them.
        weights = np.exp(np.array(evidence) - np.max(evidence, axis=0))
        weights /= weights.sum(axis=0)
        found: Array = (weights * means).sum(axis=0)
        return found, (weights * (np.array(variances) + (np.array(means) - found) ** 2)).sum(axis=0)

    def extend(self, columns: Array, prior: float | Array) -> LinearModel:
        """Add the coefficients of `columns` before the own ones."""
        count = columns.shape[1]
        return replace(
            self,
            design=np.concatenate([columns, self.design], axis=1),
            prior=np.concatenate([np.broadcast_to(prior, count), self.prior]),
            hyperpriors=tuple((which + count, scale) for which, scale in self.hyperpriors),
        )
