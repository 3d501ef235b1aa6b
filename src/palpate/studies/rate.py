"""Binomial rates with confidence intervals."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


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

        if self.trials == 0:
            return 0.0, 1.0
        found = binomtest(self.hits, self.trials).proportion_ci(method="wilson")
        return float(found.low), float(found.high)

    def __str__(self) -> str:
        low, high = self.interval
        return f"{self.hits}/{self.trials} [{low:.2f}, {high:.2f}]"
