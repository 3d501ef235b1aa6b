"""Fusion of several estimates of one quantity; shared errors are not averaged down.

Of estimates x_i, with standard deviations o_i of their own and effects s_ik of causes k that they share,
the covariance is

    C_ij = o_i² [i = j] + sum over causes k that i and j share of s_ik s_jk

and the mean with weights w = C^-1 1 / (1^T C^-1 1) is the one of least variance w^T C w (generalised least
squares, Aitken 1936). Weights are kept from being negative: an estimate would else be held against
itself, which is right only where the effects are known exactly. Whether the estimates agree tells
their scatter about the mean, by C (chi-squared). Degrees of freedom follow Welch and Satterthwaite (GUM,
JCGM 100:2008, G.4.1), the shared causes being known.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.estimation.agreement import KNOWN, FitTest, chi_squared
from palpate.estimation.estimate import Estimate, Shared, half95, rounded
from palpate.geometry.pose import Array

TINY = 1e-12
"""Relative to a variance: lest what is shared wholly makes a covariance singular."""


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """An estimate, the run that it is of, and the arm that made it.

    Arms of one name share what is `of` the arm; all arms of which nothing is known have one name.
    """

    run: str
    arm: str
    estimate: Estimate

    def causes(self) -> list[tuple[tuple[str, str], Array]]:
        """Shared errors by owner and cause, (n,) each. An estimate that names none shares its whole
        error."""
        if not self.estimate.shared:
            return [(("scene", "all that is not known"), self.estimate.stds)]
        found: list[tuple[tuple[str, str], Array]] = []
        for shared in self.estimate.shared:
            owner = self.arm if shared.of == "arm" else "scene"
            found.append(((owner, shared.cause), np.array(shared.effect)))
        return found

    @property
    def own(self) -> Array:
        """(n,) standard deviation that no other run shares."""
        if not self.estimate.shared:
            return np.zeros(len(self.estimate.stds))
        return np.sqrt(np.maximum(self.estimate.stds**2 - self.estimate.shared_std**2, 0.0))


def fuse(sources: Sequence[Source]) -> Estimate:
    """Fuse `sources` of one parameter into one estimate; a single one is returned unchanged."""
    first = sources[0].estimate
    if len(sources) == 1:
        return first
    values = np.array([source.estimate.values for source in sources])
    count = values.shape[1]
    covariances = [_covariance(sources, i) for i in range(count)]
    weights = np.column_stack([_weights(covariance) for covariance in covariances])
    value = (weights * values).sum(axis=0)
    std = np.sqrt([w @ c @ w for w, c in zip(weights.T, covariances, strict=True)])
    freedom = _freedom(sources, weights, std)
    half = std * half95(freedom)
    return Estimate(
        first.parameter,
        first.unit,
        value,
        std,
        np.column_stack([value - half, value + half]),
        _method(sources, weights, std),
        tests=(_agreement(sources, value),),
        shared=_shared(sources, weights),
        freedom=freedom,
    )


def difference(one: Source, other: Source) -> tuple[Array, Array]:
    """(n,) how much `other` is above `one`, and the standard deviation of that: what both share, as
    C_11 + C_22 - 2 C_12 has it, moves both alike and is not in it."""
    apart = [_apart(one), _apart(other)]
    stds: list[float] = []
    for i in range(len(one.estimate.values)):
        covariance = _covariance(apart, i)
        stds.append(math.sqrt(covariance[0, 0] + covariance[1, 1] - 2.0 * covariance[0, 1]))
    return other.estimate.values - one.estimate.values, np.array(stds)


def _covariance(sources: Sequence[Source], component: int) -> Array:
    """(n, n) of one component in all sources."""
    own = np.array([source.own[component] for source in sources])
    found: Array = np.diag(own**2)
    columns: dict[tuple[str, str], Array] = {}
    for i, source in enumerate(sources):
        for cause, effect in source.causes():
            columns.setdefault(cause, np.zeros(len(sources)))[i] = effect[component]
    for column in columns.values():
        found += np.outer(column, column)
    return found + TINY * np.diag(found.diagonal())


def _weights(covariance: Array) -> Array:
    """(n,) of least variance, none of them negative, their sum 1."""
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
    """Of the worst component."""
    unsure = np.zeros(len(std))
    for source, weight in zip(sources, weights, strict=True):
        noise = source.own if source.estimate.shared else source.estimate.stds
        unsure += (weight * noise) ** 4 / source.estimate.freedom
    worst = float(np.max(unsure / std**4))
    return 1.0 / worst if worst > 0.0 else math.inf


def _agreement(sources: Sequence[Source], mean: Array) -> FitTest:
    """Test for a scatter of the runs within their stated uncertainty."""
    apart = [_apart(source) for source in sources]
    values = np.array([source.estimate.values for source in sources])
    statistic = 0.0
    off = np.zeros_like(values)
    for i in range(len(mean)):
        covariance = _covariance(apart, i)
        scales = np.linalg.solve(covariance, np.ones(len(values)))
        left: Array = values[:, i] - scales @ values[:, i] / scales.sum()
        statistic += float(left @ np.linalg.solve(covariance, left))
        off[:, i] = np.abs(left) / np.sqrt(covariance.diagonal())
    farthest = sources[int(off.max(axis=1).argmax())].run
    said = "; ".join(f"{source.run} {_told(source.estimate)}" for source in sources)
    return chi_squared(
        "run against run",
        statistic,
        len(mean) * (len(sources) - 1),
        f"The runs disagree: {said}. Farthest from the others is {farthest}.",
        min(KNOWN, *(source.estimate.freedom for source in sources)),
    )


def _apart(source: Source) -> Source:
    """With all its error its own where it says nothing of that: two such may differ by as much."""
    if source.estimate.shared:
        return source
    nothing = Shared("nothing", "arm", (0.0,) * len(source.estimate.stds))
    return replace(source, estimate=replace(source.estimate, shared=(nothing,)))


def _shared(sources: Sequence[Source], weights: Array) -> tuple[Shared, ...]:
    """Error causes that the mean shares with further runs."""
    arms = {source.arm for source in sources}
    found: dict[tuple[str, str], Array] = {}
    for source, weight in zip(sources, weights, strict=True):
        for (owner, cause), effect in source.causes():
            named = cause if owner == "scene" or len(arms) == 1 else f"{cause} of {owner}"
            key = ("scene" if owner == "scene" else "arm", named)
            found[key] = found.get(key, np.zeros(len(weight))) + weight * effect
    kept: list[Shared] = []
    for (of, cause), effect in found.items():
        kept.append(Shared(cause, "scene" if of == "scene" else "arm", tuple(effect.tolist())))
    return tuple(kept)


def _method(sources: Sequence[Source], weights: Array, std: Array) -> str:
    parts: list[str] = []
    for source, weight in zip(sources, weights, strict=True):
        shares = ", ".join(f"{100 * share:.0f} %" for share in weight.tolist())
        parts.append(f"{source.run} ({shares})")
    own = np.zeros(len(std))
    for source, weight in zip(sources, weights, strict=True):
        own += (weight * source.own) ** 2
    left = np.sqrt(np.maximum(std**2 - own, 0.0))
    floors = ", ".join(f"{floor:.2g}" for floor in left.tolist())
    return (
        f"Mean of {' and '.join(parts)}, by least variance; what the runs have in common, {floors} of the "
        "standard deviation, is not averaged away."
    )


def _told(estimate: Estimate) -> str:
    pairs = zip(estimate.values.tolist(), estimate.stds.tolist(), strict=True)
    words = [" ± ".join(rounded(value, std)) for value, std in pairs]
    unit = "" if estimate.unit == "1" else f" {estimate.unit}"
    return ", ".join(words) + unit
