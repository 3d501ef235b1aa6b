"""Statistics of estimates over many seeds: bias, scatter, stated standard deviations, coverage."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from statistics import fmean, stdev

import numpy as np
from scipy.special import stdtr, stdtrit

from palpate.geometry.pose import Array
from palpate.parameter import Parameter
from palpate.studies.accuracy import ScoredEstimate, SeedRun, Unmeasured
from palpate.studies.figures import Ranged

Key = tuple[Parameter, int]
"""Parameter and index of its component."""
FREEDOMS = np.geomspace(1.0, 1e6, 2000)
"""Degrees of freedom of the table from which those of an interval are interpolated."""
QUANTILES = stdtrit(FREEDOMS, 0.975)
"""Half widths of the 95 % intervals of Student's t with these, in standard deviations."""


@dataclass(frozen=True, slots=True)
class Scores:
    """Coverage and calibration of n estimates.

    Attributes:
        runs: n.
        coverage95, coverage50: share of the 95 % and 50 % intervals that hold the truth.
        stated: 1 / RMS(z), z = error / stated standard deviation; 1 for calibrated estimates.
        worst: largest |z|.
    """

    runs: int
    coverage95: Ranged
    coverage50: Ranged
    stated: Ranged
    worst: float

    @classmethod
    def of(cls, estimates: Sequence[ScoredEstimate]) -> Scores:
        """Score at least one estimate."""
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
    """A parameter's component over all seeds, in its SI unit. Its figures are those of the seeds that
    identified it or were kept from it by a physical bound only, None without any.

    Attributes:
        runs: number of these seeds.
        truth, mean: mean true and estimated value of these.
        bias: mean error.
        sd: standard deviation of the errors.
        claimed: mean of the stated standard deviations; near `rmse` for calibrated estimates.
        covered: number of 95 % intervals that hold the truth.
        single_shot_sd: as `sd`, of the naive mean of F_z/g; None for quantities without one.
        unit: as printed.
        asked: number of all seeds.
        verdicts: number of seeds by verdict.
        rmse: root mean square of the errors.
    """

    parameter: Parameter
    component: int
    runs: int
    truth: float
    mean: float | None = None
    bias: float | None = None
    sd: float | None = None
    claimed: float | None = None
    covered: int = 0
    single_shot_sd: float | None = None
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
    return [component_summary(key, group, len(runs)) for key, group in found.items()]


def component_summary(
    key: Key, found: Sequence[ScoredEstimate | Unmeasured], asked: int
) -> Summary:
    verdicts = Counter(each.verdict for each in found)
    identified = [each for each in found if isinstance(each, ScoredEstimate)]
    identified = [each for each in identified if each.is_evidence]
    summary = Summary(
        *key,
        runs=len(identified),
        truth=fmean(each.truth for each in identified or found),
        unit=found[0].unit,
        asked=asked,
        verdicts=dict(verdicts),
    )
    if not identified:
        return summary
    # The single-shot mass F_z/g of the same recording shows what the estimator gains.
    errors = [each.error for each in identified]
    naive = [each.single_shot - each.truth for each in identified if each.single_shot is not None]
    return replace(
        summary,
        mean=fmean(each.value for each in identified),
        bias=fmean(errors),
        sd=sample_std(errors),
        claimed=fmean(each.std for each in identified),
        covered=sum(each.covered for each in identified),
        single_shot_sd=sample_std(naive) if naive else None,
        rmse=float(np.sqrt(np.mean(np.square(errors)))),
        scores=Scores.of(identified),
    )


def errors_in_std(estimates: Sequence[ScoredEstimate]) -> Array:
    """(n,) errors in stated standard deviations."""
    return np.array([each.error / each.std for each in estimates])


def shares(estimates: Sequence[ScoredEstimate]) -> Array:
    """Probability integral transform of each error, (n,): its stated distribution function at the
    error; uniform in 0…1 for calibrated estimates.

    The stated distribution is Student's t, with the degrees of freedom that give the stated upper half
    of the 95 % interval.
    """
    halves = np.array([(each.high - each.value) / each.std for each in estimates])
    # np.interp needs increasing abscissae, and the quantile falls with the degrees of freedom.
    freedom = np.interp(-halves, -QUANTILES, FREEDOMS)
    return stdtr(freedom, errors_in_std(estimates))


def levels(estimates: Sequence[ScoredEstimate]) -> Array:
    """Level of the narrowest central interval that holds the truth, (n,); uniform in 0…1 for
    calibrated estimates."""
    return np.abs(2.0 * shares(estimates) - 1.0)


def sample_std(values: Sequence[float]) -> float:
    return stdev(values) if len(values) > 1 else 0.0
