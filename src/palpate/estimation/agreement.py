"""Tests of fit: whether recordings agree with the model that an estimate was made with.

An estimator says which tests it made; one that fails makes the estimate *contradicted*. The noise
that a test compares with comes from where the model plays no part (the scatter of blocks, the
arm's stated accuracies), never from the misfit itself: a model that is wrong would excuse itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist

from palpate.estimation import tuning


@dataclass(frozen=True, slots=True)
class FitTest:
    """One test of fit.

    Attributes:
        name: what was looked at, e.g. `up against down`.
        statistic: how far it is from agreeing. limit: up to where it agrees.
        finding: what disagrees, one sentence for people; said where the test fails.
    """

    name: str
    statistic: float
    limit: float
    finding: str

    @property
    def passed(self) -> bool:
        """Whether the evidence agrees; what is no number does not."""
        return self.statistic <= self.limit


def chi_squared(name: str, statistic: float, freedom: int, finding: str) -> FitTest:
    """A sum of `freedom` squares, each of unit variance where the model holds; chance exceeds it
    with probability `tuning.FALSE_ALARM`.

    The limit is Wilson and Hilferty's k (1 - 2/9k + z sqrt(2/9k))^3, good to 1 % (The distribution
    of chi-square, PNAS 17, 1931).
    """
    z, ninth = NormalDist().inv_cdf(1.0 - tuning.FALSE_ALARM), 2.0 / (9.0 * freedom)
    return FitTest(name, statistic, freedom * (1.0 - ninth + z * ninth**0.5) ** 3, finding)
