"""Figure of each joint of an arm, with its interval."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.geometry.pose import Array

SURE = 1.96  # standard deviations of a 95 % interval


@dataclass(frozen=True, slots=True, eq=False)
class Figure:
    """A figure of each joint with its 95 % interval; NaN where the recording does not show it."""

    value: Array  # (7,)
    low: Array
    high: Array

    @classmethod
    def unseen(cls) -> Figure:
        """Return a figure that no joint shows."""
        return cls(*(np.full(7, np.nan) for _ in range(3)))

    @classmethod
    def about(cls, value: Array, std: Array, seen: NDArray[np.bool_] | bool = True) -> Figure:
        """Return values with a normal error, those that are seen."""
        value, std = np.where(seen, value, np.nan), np.where(seen, std, np.nan)
        return cls(value, value - SURE * std, value + SURE * std)

    def where(self, seen: NDArray[np.bool_]) -> Figure:
        """Return the figure with the joints that are seen."""
        return Figure(*(np.where(seen, x, np.nan) for x in (self.value, self.low, self.high)))
