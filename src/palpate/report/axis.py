"""Position of a number on an axis, for all charts, tables and bars of a page."""

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
        """Axis that spans all `values`, with a margin of `air` times their range."""
        low, high = float(np.min(values)), float(np.max(values))
        margin = air * (high - low) or 0.1 * abs(high) or 1.0
        return cls(low - margin, high + margin)

    def share(self, value: float) -> float:
        """Position of a number along it: 0 at `low`, 1 at `high`."""
        return (value - self.low) / (self.high - self.low)

    def per_cent(self, value: float) -> float:
        """The same in per cent, as a page takes it."""
        return round(100.0 * self.share(value), 2)
