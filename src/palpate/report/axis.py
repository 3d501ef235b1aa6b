"""Where a number stands on an axis: the one rule for all charts, tables and bars of a page."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.geometry.pose import Array


@dataclass(frozen=True, slots=True)
class Axis:
    """An axis from `low` to `high`."""

    low: float
    high: float

    @classmethod
    def around(cls, values: Array, air: float) -> Axis:
        """One that holds all `values`, with `air` beyond them, as a share of how far they reach."""
        low, high = float(np.min(values)), float(np.max(values))
        margin = air * (high - low) or 0.1 * abs(high) or 1.0
        return cls(low - margin, high + margin)

    def share(self, value: float) -> float:
        """How far along it a number stands: 0 at `low`, 1 at `high`."""
        return (value - self.low) / (self.high - self.low)

    def per_cent(self, value: float) -> float:
        """The same in per cent, as a page takes it."""
        return round(100.0 * self.share(value), 2)
