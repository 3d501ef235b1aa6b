"""Tests of fit: whether recordings agree with the model that an estimate was made with.

An estimator says which tests it made; one that fails makes the estimate *contradicted*. The noise
that a test compares with comes from where the model plays no part (the scatter of blocks, the
arm's stated accuracies), never from the misfit itself: a model that is wrong would excuse itself.
"""

from __future__ import annotations

from dataclasses import dataclass

from palpate.estimation import tuning

KNOWN = 1_000_000_000
"""Degrees of freedom of a variance that is known."""


@dataclass(frozen=True, slots=True)
class FitTest:
    """Goodness-of-fit test: a statistic against its limit.

    Attributes:
        name: what was looked at, e.g. `up against down`.
        statistic: how far it is from agreeing.
        limit: up to where it agrees.
        finding: what disagrees, one sentence for people; said where the test fails.
    """

    name: str
    statistic: float
    limit: float
    finding: str

    @property
    def passed(self) -> bool:
        """The statistic is within its limit; NaN is not."""
        return bool(self.statistic <= self.limit)  # numpy's bool is not JSON serializable


def chi_squared(
    name: str, statistic: float, freedom: int, finding: str, noise_freedom: float = KNOWN
) -> FitTest:
    """A sum of `freedom` squares, each of unit variance where the model holds; chance exceeds it
    with probability `tuning.FALSE_ALARM`.

    That variance was itself estimated, with `noise_freedom` degrees of freedom: the sum over
    `freedom` then is of an F distribution.
    """
    from scipy.special import fdtri

    limit = freedom * float(fdtri(freedom, noise_freedom, 1.0 - tuning.FALSE_ALARM))
    return FitTest(name, statistic, limit, finding)
