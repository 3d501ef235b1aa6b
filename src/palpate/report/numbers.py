"""Numbers as text, with as many digits as the uncertainty carries, and their positions on an axis."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from palpate.estimation.estimate import rounded
from palpate.geometry.pose import Array

SMALL = {"kg": ("g", 1e3), "m": ("mm", 1e3)}
"""Units in which errors are easier to read."""


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

    def per_cent(self, value: float) -> float:
        """Position of a number along the axis: 0 at `low`, 100 at `high`."""
        return round(100.0 * ((value - self.low) / (self.high - self.low)), 2)


def plain(values: Iterable[float]) -> str:
    """Exactly known values, separated by spaces."""
    return " ".join(f"{value:.6g}" for value in values)


def with_unit(text: str, unit: str) -> str:
    """`text` with its unit; a pure number, of unit 1, has none."""
    if unit in ("", "1"):
        return text
    return f"{text} {unit}"


def with_spread(value: float, std: float, unit: str) -> str:
    """`0.262 ± 0.020 kg`; in the smaller unit below a hundredth of the unit."""
    factor = 1.0
    if abs(value) < 1e-2:
        unit, factor = SMALL.get(unit, (unit, 1.0))
    texts = rounded(factor * value, factor * std)
    return with_unit(" ± ".join(texts) if std > 0.0 else texts[0], unit)


def error_text(value: float, truth: float, unit: str, relative: bool) -> str:
    """Error of `value` against the truth, in the smaller unit; with the `relative` error if asked."""
    unit, factor = SMALL.get(unit, (unit, 1.0))
    text = with_unit(f"{factor * (value - truth):+.2g}", unit)
    if relative and truth:
        text += f" ({100 * (value - truth) / truth:+.2g} %)"
    return text.replace("-", "−")
