"""Linear-Gaussian regression: causes + noise + y → posterior.

    y = Σ_c X_c x_c + n        x_c ~ N(0, s² P_c²)        n ~ N(0, Σ)

A *cause* c has columns X_c (effects of its unknowns on the rows y) and prior standard deviations P_c; scales s of
some causes are learned from the recording. *Noise* whitens: it brings rows to unit variance. The posterior of all
unknowns follows in closed form, averaged over the scales by their evidence (C. Bishop, Pattern Recognition and
Machine Learning, sections 3.3 and 3.5; Hoeting et al., Statistical Science 14, 1999).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array
from palpate.estimation.estimate import FitTest, Shared, chi_squared

COUNTED = 1e-4
"""probability from which a combination of hyperpriors is averaged over. Sensitive: no."""


@dataclass(frozen=True, slots=True, eq=False)
class Cause:
    """Named cause of what is observed, with k unknowns.

    Attributes:
        name: unique among the causes of a fit.
        columns: (n, k) effect of a unit of each unknown on the n rows.
        prior: (k,) standard deviations of the unknowns, about 0.
        of: `arm` or `scene` where other runs share its errors.
        labels: (k,) of its unknowns where they are shared; none: its name and their number.
    """

    name: str
    columns: Array
    prior: Array
    of: Literal["arm", "scene"] | None = None
    labels: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class PriorScale:
    """Hyperprior of the causes named: their prior deviations are `factors` times as large (a number for all
    unknowns, or an array), with prior probability `chance` each."""

    causes: tuple[str, ...]
    factors: Sequence[float | Array]
    chance: Sequence[float]


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
    """Noise of rows ordered by signal, independent between signals.

    Attributes:
        roots: of each signal, the lower triangle (k, k) whose square is its covariance.
        freedom: degrees of freedom of that.
    """

    roots: Sequence[Array]
    freedom: float

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
    """Noise with further unknowns without a prior, which are projected out of all rows (Frisch and Waugh,
    Econometrica 1, 1933).

    Attributes:
        noise: of the rows.
        basis: (n, k) orthonormal, of the whitened columns of these unknowns.
    """

    noise: RowNoise
    basis: Array

    @classmethod
    def of(cls, noise: RowNoise, columns: Array) -> Projected:
        """Noise with the unknowns of `columns` (n, k)."""
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
    """Rows (n, p) in units of a lower triangle `root` (n, n)."""
    from scipy.linalg.lapack import dtrtrs

    # LAPACK's matrices go by columns, so that it takes the root for its transpose.
    return dtrtrs(root.T, rows, lower=False, trans=True)[0]


def fit(
    causes: Sequence[Cause],
    noise: RowNoise,
    y: Array,
    scales: Sequence[PriorScale] = (),
    first: int | None = None,
) -> Posterior:
    """Fit the unknowns of all `causes` to rows `y` (n,); of their covariance only the `first` rows, if given."""
    model = whitened_model(causes, noise, y, scales)
    return Posterior(tuple(causes), noise, model, *model.solve(first))


def whitened_model(
    causes: Sequence[Cause], noise: RowNoise, y: Array, scales: Sequence[PriorScale]
) -> LinearModel:
    """Model of rows `y` (n,) in units of the noise."""
    design = noise.white(np.concatenate([cause.columns for cause in causes], axis=1))
    prior = np.concatenate([cause.prior for cause in causes])
    places, every = place_unknowns(causes), np.arange(len(prior), dtype=np.intp)
    hyperpriors: list[ScaleHyperprior] = []
    for scale in scales:
        which = np.concatenate([every[places[name]] for name in scale.causes])
        hyperpriors.append(ScaleHyperprior(which, scale.factors, scale.chance))
    return LinearModel(design, noise.white(y), prior, noise.freedom, tuple(hyperpriors))


def place_unknowns(causes: Sequence[Cause]) -> dict[str, slice]:
    """Places of the unknowns of each cause, by its name."""
    ends = np.cumsum([0, *(len(cause.prior) for cause in causes)]).tolist()
    pairs = zip(causes, ends[:-1], ends[1:], strict=True)
    return {cause.name: slice(first, last) for cause, first, last in pairs}


@dataclass(frozen=True, slots=True, eq=False)
class Posterior:
    """Normal posterior of the p unknowns of all causes.

    Attributes:
        causes, noise: of the fit.
        model: whitened.
        mean: (p,) of all unknowns, cause after cause.
        covariance: (p, p) of them, or its first rows.
        errors: (p, p) effects on the estimates of one prior deviation of each unknown, or the first rows.
        density: log probability density of the whitened rows.
    """

    causes: tuple[Cause, ...]
    noise: RowNoise
    model: LinearModel
    mean: Array
    covariance: Array
    errors: Array
    density: float

    def __getitem__(self, name: str) -> tuple[Array, Array]:
        """Mean (k,) and covariance (k, k) of the unknowns of a cause."""
        here = place_unknowns(self.causes)[name]
        return self.mean[here], self.covariance[here, here]

    @property
    def residual(self) -> Array:
        """(n,) what is left of the rows, in units of the noise."""
        return self.model.y - self.model.design @ self.mean

    @property
    def leverage(self) -> Array:
        """(n,) part of each row's noise that the fit follows."""
        return ((self.model.design @ self.covariance) * self.model.design).sum(axis=1)

    @property
    def evidence(self) -> float:
        """Log probability density of the rows, but for a constant of their number."""
        return self.density - self.noise.volume

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the noise."""
        return self.noise.freedom

    def shared(self, name: str) -> tuple[Shared, ...]:
        """Errors of the unknowns of `name` in common with other runs: the effects of one standard deviation of
        each unknown that the arm or the scene brings along."""
        places = place_unknowns(self.causes)
        found: list[Shared] = []
        for cause in self.causes:
            if cause.of is None:
                continue
            numbered = tuple(f"{cause.name} {i + 1}" for i in range(len(cause.prior)))
            labels = cause.labels or numbered
            effects = self.effects(cause.name)[places[name]].T.tolist()
            for label, effect in zip(labels, effects, strict=True):
                found.append(Shared(label, cause.of, tuple(effect)))
        return tuple(found)

    def effects(self, name: str) -> Array:
        """(p, k) effects on all estimates, or the first, of one prior deviation of each unknown of a cause.

        The sum of their squares over all unknowns is at most the variance of the estimate.
        """
        return self.errors[:, place_unknowns(self.causes)[name]]

    def test(
        self, cause: Cause, tolerated: Array, finding: str | Callable[[Array], str]
    ) -> FitTest:
        """Wald test for a further cause, of whose unknowns `tolerated` (k,) are no matter (1 sigma); `finding` says
        what disagrees, by the mean (k + p,) of its unknowns and of all others."""
        count = len(cause.prior)
        wider = self.model.extend(self.noise.white(cause.columns), cause.prior)
        mean, covariance, *_ = wider.solve(count)
        spread = covariance[:, :count] + np.diag(tolerated**2)
        statistic = float(mean[:count] @ np.linalg.solve(spread, mean[:count]))
        text = finding if isinstance(finding, str) else finding(mean)
        return chi_squared(cause.name, statistic, count, text, self.freedom)

    def each_alone(self, columns: Array, prior: float) -> tuple[Array, Array]:
        """Posterior means and variances (k,) of further unknowns with `columns` (n, k), each beside the others
        alone."""
        return self.model.each_alone(self.noise.white(columns), prior)


class _Information(NamedTuple):
    """Information on some unknowns: their prior deviations (p,), and its Cholesky factor in units of these, so that
    known ones (deviation 0) need no inverse."""

    prior: Array
    root: Array

    @classmethod
    def of(cls, prior: Array, gram: Array) -> _Information:
        """That of rows with the inner products `gram` (p, p) of their columns."""
        from scipy.linalg.lapack import dpotrf

        information = prior[:, None] * gram * prior
        information.flat[:: len(prior) + 1] += 1.0
        # LAPACK's matrices go by columns; this one is symmetric.
        return cls(prior, dpotrf(information.T, lower=True)[0])

    @property
    def volume(self) -> float:
        """Half the log determinant, in units of the prior deviations."""
        return float(np.log(np.diag(self.root)).sum())

    def solve(self, columns: Array) -> Array:
        """Covariance of the unknowns, times `columns` (p, k)."""
        return self.per_deviation(self.prior[:, None] * columns)

    def per_deviation(self, columns: Array) -> Array:
        """Covariance of the unknowns over their prior deviations, times `columns` (p, k)."""
        from scipy.linalg.lapack import dpotrs

        if not columns.size:
            return np.zeros_like(columns)
        return dpotrs(self.root, columns, lower=True)[0] * self.prior[:, None]


class _Solved(NamedTuple):
    """Posterior of the unknowns whose scale is chosen."""

    information: _Information
    mean: Array
    evidence: float


@dataclass(frozen=True, slots=True, eq=False)
class _Reduced:
    """Normal equations of the v unknowns whose scale is chosen, with the f others integrated out (Schur complement).

    Given these, x, the others have the mean `offset` - `slope` x, whatever the scales.

    Attributes:
        scaled, others: (v,), (f,) their places among all.
        information: on the others, given these.
        offset, slope: (f,), (f, v).
        gram, projected: (v, v), (v,) what is left of the columns' inner products, and of those with `y`.
        evidence: of the others.
    """

    scaled: NDArray[np.intp]
    others: NDArray[np.intp]
    information: _Information
    offset: Array
    slope: Array
    gram: Array
    projected: Array
    evidence: float

    @classmethod
    def of(cls, model: LinearModel) -> _Reduced:
        """Integrate out the unknowns of a model that have no hyperprior."""
        every = np.arange(len(model.prior), dtype=np.intp)
        chosen = np.isin(
            every, np.concatenate([every[:0], *(h.columns for h in model.hyperpriors)])
        )
        scaled, others = every[chosen], every[~chosen]
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
        """Mean (p,), covariance (first, p) and effects of one prior deviation (first, p) of all unknowns.

        Args:
            mean: (v,) of those whose scale is chosen.
            covariance: (v, v) of these, with the spread of the means.
            within: (2, v, v) their covariance without that spread; and the same over their prior deviations.
            first: number of rows.
        """
        count = len(self.scaled) + len(self.others)
        follow = np.empty((count, len(mean)))
        follow[self.scaled], follow[self.others] = np.eye(len(mean)), -self.slope
        means = follow @ mean
        means[self.others] += self.offset
        covariances: Array = follow[:first] @ covariance @ follow.T
        # The error of the estimates is -covariance P^-2 x, with coefficients x of prior deviations P.
        errors = np.empty_like(covariances)
        deviation = np.where(self.information.prior > 0.0, self.information.prior, np.inf)
        errors[:, self.scaled] = -follow[:first] @ within[1]
        errors[:, self.others] = follow[:first] @ within[0] @ self.slope.T / deviation
        head = self.others[self.others < first]
        own = self.information.solve(np.eye(len(self.others), len(head)))
        covariances[np.ix_(head, self.others)] += own.T
        errors[np.ix_(head, self.others)] -= own.T / deviation
        return means, covariances, errors


@dataclass(frozen=True, slots=True, eq=False)
class ScaleHyperprior:
    """Discrete hyperprior: the prior deviations of some coefficients are scaled by one of `factors`
    (a number for all of them, or an array), with prior probability `chance` each."""

    columns: NDArray[np.intp]
    factors: Sequence[float | Array]
    chance: Sequence[float]


@dataclass(frozen=True, slots=True, eq=False)
class LinearModel:
    """Linear model in rows of unit variance: `y` (n,) = `design` (n, p) times coefficients with prior deviations
    `prior` (p,), some of whose scales have `hyperpriors`; the variance has `freedom` degrees of freedom."""

    design: Array
    y: Array
    prior: Array
    freedom: float
    hyperpriors: tuple[ScaleHyperprior, ...]

    def solve(self, first: int | None = None) -> tuple[Array, Array, Array, float]:
        """Posterior averaged over the hyperpriors (Bayesian model averaging: Hoeting et al., Statistical Science 14,
        1999).

        Returns:
            Mean (p,); covariance (first, p), all p rows by default; effects (first, p) on the estimates of one prior
            deviation of each coefficient, of the scale that each combination chooses; and the logarithm of the
            probability density of `y`, but for a constant.
        """
        reduced = _Reduced.of(self)
        every = self._every(reduced)
        evidence = np.array([each.evidence for each in every])
        weights = np.exp(evidence - evidence.max())
        density = float(evidence.max() + np.log(weights.sum()) - 0.5 * self.y @ self.y)
        weights /= weights.sum()
        counted = np.flatnonzero(weights > COUNTED)
        weights = weights[counted] / weights[counted].sum()
        solved = [every[i] for i in counted.tolist()]
        means = np.array([each.mean for each in solved])
        mean: Array = weights @ means
        covariance: Array = (means - mean).T @ (weights[:, None] * (means - mean))
        # The spread of the means between scales is no error that one scale explains.
        within = np.zeros((2, *covariance.shape))
        for weight, each in zip(weights, solved, strict=True):
            carried = each.information.per_deviation(np.eye(len(mean)))
            within += weight * np.array([carried * each.information.prior, carried])
        count = len(self.prior) if first is None else first
        return *reduced.all_of(mean, covariance + within[0], within, count), density

    def _every(self, reduced: _Reduced) -> Sequence[_Solved]:
        """Posteriors for each combination of the hyperpriors' factors."""
        place = np.searchsorted(reduced.scaled, np.arange(len(self.prior)))
        columns = [place[each.columns] for each in self.hyperpriors]
        choices = product(*(range(len(each.factors)) for each in self.hyperpriors))
        return [self._solve(choice, columns, reduced) for choice in choices]

    def _solve(
        self, choice: tuple[int, ...], columns: Sequence[NDArray[np.intp]], reduced: _Reduced
    ) -> _Solved:
        """Posterior with the chosen scale factors of `columns`. Its evidence is the log probability of the
        choice and of `y`, up to a constant common to all choices (Bishop, Pattern Recognition and
        Machine Learning, section 3.5.1)."""
        prior, chance = self.prior[reduced.scaled], reduced.evidence
        for each, here, i in zip(self.hyperpriors, columns, choice, strict=True):
            prior[here] *= each.factors[i]
            chance += float(np.log(each.chance[i]))
        information = _Information.of(prior, reduced.gram)
        mean = information.solve(reduced.projected[:, None])[:, 0]
        evidence = chance + 0.5 * float(mean @ reduced.projected) - information.volume
        return _Solved(information, mean, evidence)

    def each_alone(self, columns: Array, prior: float) -> tuple[Array, Array]:
        """Posterior means and variances (k,) of the coefficients of `columns` (n, k), each added to the model
        alone."""
        reduced = _Reduced.of(self)
        across = self.design.T @ columns
        others = across[reduced.others]
        # Less what the unknowns without a hyperprior explain.
        squares = (columns**2).sum(axis=0) - (others * reduced.information.solve(others)).sum(
            axis=0
        )
        projected = columns.T @ self.y - others.T @ reduced.offset
        shared = across[reduced.scaled] - reduced.slope.T @ others
        means: list[Array] = []
        variances: list[Array] = []
        evidence: list[Array] = []
        for each in self._every(reduced):
            known = (shared * each.information.solve(shared)).sum(axis=0)
            variance = 1.0 / (np.maximum(squares - known, 0.0) + prior**-2)
            mean = variance * (projected - shared.T @ each.mean)
            means.append(mean)
            variances.append(variance)
            evidence.append(each.evidence + 0.5 * (mean**2 / variance + np.log(variance)))
        weights = np.exp(np.array(evidence) - np.max(evidence, axis=0))
        weights /= weights.sum(axis=0)
        found: Array = (weights * means).sum(axis=0)
        return found, (weights * (np.array(variances) + (np.array(means) - found) ** 2)).sum(axis=0)

    def extend(self, columns: Array, prior: float | Array) -> LinearModel:
        """Model with the coefficients of `columns` in front of its own."""
        count = columns.shape[1]
        hyperpriors = [replace(each, columns=each.columns + count) for each in self.hyperpriors]
        return replace(
            self,
            design=np.concatenate([columns, self.design], axis=1),
            prior=np.concatenate([np.broadcast_to(prior, count), self.prior]),
            hyperpriors=tuple(hyperpriors),
        )
