"""Rates and figures with their 95 % intervals, and cells of the tables that show them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import sqrt

import numpy as np

from palpate.geometry.pose import Array


@dataclass(frozen=True, slots=True)
class Rate:
    """`hits` of `trials` with the 95 % Wilson score interval."""

    hits: int
    trials: int

    @classmethod
    def of(cls, outcomes: Iterable[bool]) -> Rate:
        """Count the true outcomes."""
        listed = list(outcomes)
        return cls(sum(listed), len(listed))

    @property
    def interval(self) -> tuple[float, float]:
        """(low, high) of the rate."""
        from scipy.stats import binomtest

        if self.trials == 0:  # nothing is known of the rate
            return 0.0, 1.0
        found = binomtest(self.hits, self.trials).proportion_ci(method="wilson")
        return float(found.low), float(found.high)

    def __str__(self) -> str:
        low, high = self.interval
        return f"{self.hits}/{self.trials} [{low:.2f}, {high:.2f}]"


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
        from scipy.special import chdtri

        n, value = len(numbers), float(np.sqrt(np.mean(numbers**2)))
        # chdtri(n, p) is the χ² value that is exceeded with probability p.
        low, high = n / chdtri(n, 0.025), n / chdtri(n, 0.975)
        return cls(value, value * sqrt(low), value * sqrt(high))

    @property
    def inverse(self) -> Ranged:
        """1/value with its interval; zero for zero."""
        if self.value == 0.0:
            return Ranged(0.0, 0.0, 0.0)
        return Ranged(1.0 / self.value, 1.0 / self.high, 1.0 / self.low)


@dataclass(frozen=True, slots=True)
class Cell:
    """Table cell: text, small print below it, and a mark: `good`, `warn`, `bad` or nothing."""

    text: str
    below: str = ""
    mark: str = ""


Line = tuple[str, Iterable[Cell]]
"""Table row: its name and its cells."""
