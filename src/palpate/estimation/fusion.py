"""Fusion of several estimates of one quantity; shared errors are not averaged down.

For estimates x_i with own standard deviations o_i and effects s_ik of shared causes k, the covariance is

    C_ij = o_i² [i = j] + sum over causes k that i and j share of s_ik s_jk

The mean with weights w = C^-1 1 / (1^T C^-1 1) has the least variance w^T C w (generalised least squares,
Aitken 1936). Weights are constrained to be non-negative: negative ones are right only for exactly known effects.
A chi-squared test with C compares the scatter of the estimates about the mean. Degrees of freedom follow Welch
and Satterthwaite (GUM, JCGM 100:2008, G.4.1), with the shared causes known.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.common.pose import Array
from palpate.estimation.estimate import (
    KNOWN,
    Estimate,
    FitTest,
    Shared,
    add_shared,
    chi_squared,
    half95,
    round_to_std,
)

TINY = 1e-12
"""Relative to a variance. It keeps a covariance regular where all errors are shared."""


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """Estimate with the names of its run and its arm.

    Arms of one name share the errors `of` the arm. All unknown arms have one name.
    """

    run: str
    arm: str
    estimate: Estimate

    def causes(self) -> list[tuple[tuple[str, str], Array]]:
        """Shared errors, (n,) each, by owner and cause."""
        if not self.estimate.shared:
            # Without named causes, all of the error counts as shared.
            return [(("scene", "all that is not known"), self.estimate.stds)]
        found: list[tuple[tuple[str, str], Array]] = []
        for shared in self.estimate.shared:
            owner = self.arm if shared.of == "arm" else "scene"
            found.append(((owner, shared.cause), np.array(shared.effect)))
        return found

    @property
    def own(self) -> Array:
        """(n,) standard deviation of the errors that no other run shares."""
        if not self.estimate.shared:
            return np.zeros(len(self.estimate.stds))
        return np.sqrt(np.maximum(self.estimate.stds**2 - self.estimate.shared_std**2, 0.0))


def fuse(sources: Sequence[Source]) -> Estimate:
    """Fuse `sources` of one parameter into one estimate; a single one is returned unchanged."""
    first = sources[0].estimate
    if len(sources) == 1:
        return first
    # Weights of least variance, component by component.
    values = np.array([source.estimate.values for source in sources])
    count = values.shape[1]
    covariances = [component_covariance(sources, i) for i in range(count)]
    weights = np.column_stack([least_variance_weights(covariance) for covariance in covariances])
    value = (weights * values).sum(axis=0)
    std = np.sqrt([w @ c @ w for w, c in zip(weights.T, covariances, strict=True)])
    # Interval of Student's t with the effective degrees of freedom.
    freedom = _freedom(sources, weights, std)
    half = std * half95(freedom)
    return Estimate(
        first.parameter,
        first.unit,
        value,
        std,
        np.column_stack([value - half, value + half]),
        _method(sources, weights, std),
        tests=(agreement_test(sources, value),),
        shared=_merge_shared_errors(sources, weights),
        freedom=freedom,
        bounds=first.bounds,
    )


def difference(one: Source, other: Source) -> tuple[Array, Array]:
    """Difference (n,) of `other` from `one`, and its standard deviation, in which shared errors cancel."""
    return weighted_sum([one, other], (-1.0, 1.0))


def weighted_sum(sources: Sequence[Source], weights: Sequence[float]) -> tuple[Array, Array]:
    """Weighted sum (n,) of w_i x_i, and its standard deviation sqrt(w^T C w). Unnamed errors are not shared."""
    apart, w = [_make_errors_own(source) for source in sources], np.array(weights)
    count = len(sources[0].estimate.values)
    variances = [w @ component_covariance(apart, i) @ w for i in range(count)]
    return w @ np.array([source.estimate.values for source in sources]), np.sqrt(variances)


def component_covariance(sources: Sequence[Source], component: int) -> Array:
    """Covariance (n, n) of one component over all sources."""
    own = np.array([source.own[component] for source in sources])
    found: Array = np.diag(own**2)
    # Each shared cause adds the outer product of its effects on the sources.
    columns: dict[tuple[str, str], Array] = {}
    for i, source in enumerate(sources):
        for cause, effect in source.causes():
            columns.setdefault(cause, np.zeros(len(sources)))[i] = effect[component]
    for column in columns.values():
        found += np.outer(column, column)
    return found + TINY * np.diag(found.diagonal())


def least_variance_weights(covariance: Array) -> Array:
    """Non-negative weights (n,) of least variance, with sum 1."""
    # Active set: drop the source with the most negative weight until none is left.
    used = np.arange(len(covariance))
    while True:
        unscaled = np.linalg.solve(covariance[np.ix_(used, used)], np.ones(len(used)))
        if unscaled.min() >= 0.0:
            break
        used = np.delete(used, int(unscaled.argmin()))
    found = np.zeros(len(covariance))
    found[used] = unscaled / unscaled.sum()
    return found


def _freedom(sources: Sequence[Source], weights: Array, std: Array) -> float:
    """Effective degrees of freedom of the worst component (Welch and Satterthwaite)."""
    unsure = np.zeros(len(std))
    for source, weight in zip(sources, weights, strict=True):
        noise = source.own if source.estimate.shared else source.estimate.stds
        unsure += (weight * noise) ** 4 / source.estimate.freedom
    worst = float(np.max(unsure / std**4))
    return 1.0 / worst if worst > 0.0 else math.inf


def agreement_test(sources: Sequence[Source], mean: Array) -> FitTest:
    """Test that the scatter of the runs agrees with their stated uncertainty."""
    apart = [_make_errors_own(source) for source in sources]
    values = np.array([source.estimate.values for source in sources])
    statistic = 0.0
    off = np.zeros_like(values)
    # Chi-squared about the generalised mean, and the largest deviation of each run.
    for i in range(len(mean)):
        covariance = component_covariance(apart, i)
        scales = np.linalg.solve(covariance, np.ones(len(values)))
        left: Array = values[:, i] - scales @ values[:, i] / scales.sum()
        statistic += float(left @ np.linalg.solve(covariance, left))
        off[:, i] = np.abs(left) / np.sqrt(covariance.diagonal())
    # Name the run with the largest deviation, and list all values.
    farthest = sources[int(off.max(axis=1).argmax())].run
    shown: list[str] = []
    for source in sources:
        pairs = zip(source.estimate.values.tolist(), source.estimate.stds.tolist(), strict=True)
        unit = "" if source.estimate.unit == "1" else f" {source.estimate.unit}"
        numbers = ", ".join(" ± ".join(round_to_std(value, std)) for value, std in pairs)
        shown.append(f"{source.run} {numbers}{unit}")
    return chi_squared(
        "run against run",
        statistic,
        len(mean) * (len(sources) - 1),
        f"The runs disagree: {'; '.join(shown)}. Farthest from the others is {farthest}.",
        min(KNOWN, *(source.estimate.freedom for source in sources)),
    )


def _make_errors_own(source: Source) -> Source:
    """Copy of a source with its unnamed errors as own ones, so that two sources may differ by as much."""
    if source.estimate.shared:
        return source
    nothing = Shared("nothing", "arm", (0.0,) * len(source.estimate.stds))
    return replace(source, estimate=replace(source.estimate, shared=(nothing,)))


def _merge_shared_errors(sources: Sequence[Source], weights: Array) -> tuple[Shared, ...]:
    """Error causes that the fused estimate shares with further runs, with weighted effects."""
    arms = {source.arm for source in sources}
    found: list[Shared] = []
    # Sum the weighted effects of each cause; a cause in one arm keeps that arm's name among several.
    for source, weight in zip(sources, weights, strict=True):
        for (owner, cause), effect in source.causes():
            named = cause if owner == "scene" or len(arms) == 1 else f"{cause} of {owner}"
            of = "scene" if owner == "scene" else "arm"
            found.append(Shared(named, of, tuple((weight * effect).tolist())))
    return add_shared(found)


def _method(sources: Sequence[Source], weights: Array, std: Array) -> str:
    """Describe the sources with their weights, and the shared error."""
    parts: list[str] = []
    for source, weight in zip(sources, weights, strict=True):
        shares = ", ".join(f"{100 * share:.0f} %" for share in weight.tolist())
        parts.append(f"{source.run} ({shares})")
    # Remaining standard deviation without the runs' own errors: the shared part.
    own = np.sum([(w * one.own) ** 2 for one, w in zip(sources, weights, strict=True)], axis=0)
    left = np.sqrt(np.maximum(std**2 - own, 0.0))
    floors = ", ".join(f"{floor:.2g}" for floor in left.tolist())
    return (
        f"Mean of {' and '.join(parts)}, by least variance; what the runs have in common, {floors} of the "
        "standard deviation, is not averaged away."
    )
