"""Numbers as people read them: as many digits as the uncertainty carries, in units of a handy
size."""

from __future__ import annotations

from collections.abc import Iterable

from palpate.estimation.estimate import rounded

SMALL = {"kg": ("g", 1e3), "m": ("mm", 1e3)}
"""Units in which errors are easier to read."""


def plain(values: Iterable[float]) -> str:
    """Values that are known exactly, one after the other."""
    return " ".join(f"{value:.6g}" for value in values)


def with_unit(text: str, unit: str) -> str:
    """`text` with its unit; a pure number, of unit 1, has none."""
    if unit in ("", "1"):
        return text
    return f"{text} {unit}"


def with_spread(value: float, std: float, unit: str) -> str:
    """`0.262 ± 0.020 kg`; what is below a hundredth of its unit is given in the smaller one."""
    factor = 1.0
    if abs(value) < 1e-2:
        unit, factor = SMALL.get(unit, (unit, 1.0))
    told = rounded(factor * value, factor * std)
    return with_unit(" ± ".join(told) if std > 0.0 else told[0], unit)


def error_text(value: float, truth: float, unit: str, relative: bool) -> str:
    """Error of `value` against the truth, in the smaller unit, and `relative`ly where asked."""
    unit, factor = SMALL.get(unit, (unit, 1.0))
    text = with_unit(f"{factor * (value - truth):+.2g}", unit)
    if relative and truth:
        text += f" ({100 * (value - truth) / truth:+.2g} %)"
    return text.replace("-", "−")
