"""Statistics of estimates over many seeds: bias, scatter, stated standard deviations, coverage."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from math import sqrt
from statistics import fmean, stdev

import numpy as np
from scipy.special import chdtri, stdtr, stdtrit

from palpate.geometry.pose import Array
from palpate.parameter import Parameter
from palpate.studies.accuracy import ScoredEstimate, SeedRun, Unmeasured
from palpate.studies.rate import Rate

Key = tuple[Parameter, int]
"""A parameter and a component of it."""
FREEDOMS = np.geomspace(1.0, 1e6, 2000)
"""Degrees of freedom among which those of an interval are looked up."""
QUANTILES = stdtrit(FREEDOMS, 0.975)
"""Half the width of their 95 % intervals, in standard deviations."""


@dataclass(frozen=True, slots=True)
class Ranged:
    """A figure with its 95 % interval."""

    value: float
    low: float
    high: float

    @classmethod
    def share(cls, outcomes: Iterable[bool]) -> Ranged:
        """Share of true outcomes, with the Wilson interval."""
        rate = Rate.of(outcomes)
        return cls(rate.hits / max(rate.trials, 1), *rate.interval)

    @classmethod
    def rms(cls, numbers: Array) -> Ranged:
        """Root mean square of (n,) independent normal numbers about zero: n RMS²/σ² is χ² with n
        degrees of freedom (Kay, Fundamentals of Statistical Signal Processing I, 1993, app. 3)."""
        n, value = len(numbers), float(np.sqrt(np.mean(numbers**2)))
        low, high = n / chdtri(n, 0.025), n / chdtri(n, 0.975)
        return cls(value, value * sqrt(low), value * sqrt(high))

    @property
    def inverse(self) -> Ranged:
        """1/value with its interval; zero for zero."""
        if self.value == 0.0:
            return Ranged(0.0, 0.0, 0.0)
        return Ranged(1.0 / self.value, 1.0 / self.high, 1.0 / self.low)


@dataclass(frozen=True, slots=True)
class Scores:
    """Coverage and calibration of n estimates.

    Attributes:
        runs: how many.
        coverage95, coverage50: share of the 95 % and 50 % intervals that hold the truth.
        stated: one over the root mean square of the errors in stated standard deviations.
        worst: the largest of these.
    """

    runs: int
    coverage95: Ranged
    coverage50: Ranged
    stated: Ranged
    worst: float

    @classmethod
    def of(cls, estimates: Sequence[ScoredEstimate]) -> Scores:
        """Of at least one."""
        z = errors_in_std(estimates)
        return cls(
            len(estimates),
            Ranged.share(each.covered for each in estimates),
            Ranged.share(bool(level <= 0.5) for level in levels(estimates)),
            Ranged.rms(z).inverse,
            float(np.abs(z).max()),
        )


@dataclass(frozen=True, slots=True)
class Summary:
    """A parameter's component over all seeds, in its SI unit. Its figures are those of the seeds
    that identified it, None where none did.

    Attributes:
        runs: seeds that identified it.
        truth, mean: over these.
        bias: mean error.
        sd: standard deviation of the errors.
        claimed: mean of the stated standard deviations, which an honest estimator holds near `rmse`.
        covered: how many 95 % intervals hold the truth.
        single_shot_sd: as `sd`, of the naive weighing; None where there is none.
        unit: as printed.
        asked: seeds that should have identified it.
        verdicts: how many ended with which.
        rmse: root mean square of the errors.
    """

    parameter: Parameter
    component: int
    runs: int
    truth: float
    mean: float | None
    bias: float | None
    sd: float | None
    claimed: float | None
    covered: int
    single_shot_sd: float | None
    unit: str = ""
    asked: int = 0
    verdicts: dict[str, int] = field(default_factory=dict[str, int])
    rmse: float | None = None
    scores: Scores | None = None

    @property
    def key(self) -> Key:
        return self.parameter, self.component


def summarise(runs: Sequence[SeedRun]) -> list[Summary]:
    """Summarise each component of each parameter, in order of first appearance."""
    found: dict[Key, list[ScoredEstimate | Unmeasured]] = {}
    for run in runs:
        for each in (*run.estimates, *run.doubted, *run.unmeasured):
            found.setdefault((each.parameter, each.component), []).append(each)
    return [_summary(key, group, len(runs)) for key, group in found.items()]


def _summary(key: Key, found: Sequence[ScoredEstimate | Unmeasured], asked: int) -> Summary:
    verdicts = Counter(each.verdict for each in found)
    identified = [each for each in found if isinstance(each, ScoredEstimate)]
    identified = [each for each in identified if each.verdict == "identified"]
    about = (found[0].unit, asked, dict(verdicts))
    if not identified:
        truth = fmean(each.truth for each in found)
        return Summary(*key, 0, truth, None, None, None, None, 0, None, *about)
    errors = [each.error for each in identified]
    naive = [each.single_shot - each.truth for each in identified if each.single_shot is not None]
    return Summary(
        *key,
        len(identified),
        fmean(each.truth for each in identified),
        fmean(each.value for each in identified),
        fmean(errors),
        _sd(errors),
        fmean(each.std for each in identified),
        sum(each.covered for each in identified),
        _sd(naive) if naive else None,
        *about,
        float(np.sqrt(np.mean(np.square(errors)))),
        Scores.of(identified),
    )


def errors_in_std(estimates: Sequence[ScoredEstimate]) -> Array:
    """(n,) errors in stated standard deviations."""
    return np.array([each.error / each.std for each in estimates])


def shares(estimates: Sequence[ScoredEstimate]) -> Array:
    """(n,) of each the share of its stated distribution that lies below an error as large as its
    own; of honest ones they are even in 0…1.

    The distribution is Student's t with as many degrees of freedom as make the stated upper half of
    the 95 % interval; the lower one may be cut off where a quantity ends.
    """
    halves = np.array([(each.high - each.value) / each.std for each in estimates])
    # The quantile falls with the degrees of freedom.
    freedom = np.interp(-halves, -QUANTILES, FREEDOMS)
    return stdtr(freedom, errors_in_std(estimates))


def levels(estimates: Sequence[ScoredEstimate]) -> Array:
    """(n,) of each the level of the narrowest central interval that holds the truth; of honest
    ones they are even in 0…1."""
    return np.abs(2.0 * shares(estimates) - 1.0)


def _sd(values: Sequence[float]) -> float:
    return stdev(values) if len(values) > 1 else 0.0
