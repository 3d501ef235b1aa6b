"""Agreement of estimates: tests of fit, and physical bounds.

A test of fit asks whether recordings agree with the model that an estimate was made with.

An estimator says which tests it made; one that fails makes the estimate *contradicted*. The noise
that a test compares with comes from where the model plays no part (the scatter of blocks, the
arm's stated accuracies), never from the misfit itself: a model that is wrong would excuse itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from palpate.estimation import tuning

KNOWN = 1_000_000_000
"""Degrees of freedom of a variance that is known."""
OUTSIDE = 0.05
"""Probability that a one-sided limit leaves out."""


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


@dataclass(frozen=True, slots=True)
class Bound:
    """Physical bound of a value: a lower one, or with `sign` -1 an upper one, which is mirrored."""

    at: float
    sign: Literal[1, -1] = 1

    @property
    def words(self) -> str:
        """Sense of the one-sided limit that a value near the bound has."""
        return "at most" if self.sign > 0 else "at least"

    def limit(self, value: float, std: float, freedom: float = math.inf) -> float:
        """One-sided 95 % limit u of a value that is not below the bound b, estimated as `value` ± `std`.

        u solves P(T > (u - value) / std) = 0.05 P(T < (value - b) / std) with Student's T of `freedom` degrees of
        freedom. This is the CLs limit, and the Bayesian one with a flat prior above b (A. L. Read, J. Phys. G 28,
        2693, 2002). It is never below b, and it covers the truth with 95 % or more wherever that is.
        """
        from scipy.special import ndtr, ndtri, stdtr, stdtrit

        away = self.sign * (value - self.at) / std
        if math.isinf(freedom):
            quantile = float(ndtri(OUTSIDE * ndtr(away)))
        else:
            quantile = float(stdtrit(freedom, OUTSIDE * stdtr(freedom, away)))
        return value - self.sign * std * quantile

    def moments(self, value: float, std: float) -> tuple[float, float]:
        """Mean and standard deviation of a normal variable, given that it is not below the bound b.

        With alpha = (b - value) / std and the hazard h = pdf(alpha) / (1 - cdf(alpha)) of the standard normal, they
        are value + std h and std sqrt(1 + alpha h - h²) (Johnson, Kotz and Balakrishnan, Continuous Univariate
        Distributions 1, section 10.1).
        """
        from scipy.special import log_ndtr

        alpha = self.sign * (self.at - value) / std
        hazard = math.exp(-0.5 * alpha**2 - float(log_ndtr(-alpha))) / math.sqrt(2.0 * math.pi)
        spread = std * math.sqrt(max(1.0 + alpha * hazard - hazard**2, 1e-6))
        return value + self.sign * std * hazard, spread


def reached_bound(low: float, high: float, bounds: tuple[float, float]) -> Bound | None:
    """The one of two `bounds`, least and largest, that the interval from `low` to `high` reaches. None for neither, and
    for an exact value, whose interval has no width."""
    if low == high:
        return None
    if low <= bounds[0]:
        return Bound(bounds[0])
    return Bound(bounds[1], -1) if high >= bounds[1] else None
