"""Estimates as text: value and error with the digits that the error justifies."""

from __future__ import annotations

from dataclasses import dataclass

from palpate.common.pose import Array
from palpate.estimation.estimate import Estimate, Verdict, axes_of, round_to_std


@dataclass(frozen=True, slots=True)
class ComponentText:
    """Component of an estimate as text; all numbers have the same digits after the point."""

    axis: str  # its name, empty for a scalar
    # value, std: estimate and standard deviation.
    value: str
    std: str
    # low, high: ends of the interval.
    low: str
    high: str
    verdict: Verdict  # of the component
    limit: str = ""  # its one-sided limit, `at most 0.007`, at a bound


def figures(estimate: Estimate) -> tuple[ComponentText, ...]:
    """Format the components of an estimate; none without a value."""
    axes = axes_of(len(estimate.values))
    texts: list[ComponentText] = []
    for i, axis in enumerate(axes):
        # Round all numbers to the digits of the standard deviation.
        std = float(estimate.stds[i])
        value, spread = round_to_std(float(estimate.values[i]), std)
        limit = estimate.limit_in_words(i)
        low, high = (round_to_std(bound, std)[0] for bound in estimate.intervals[i].tolist())
        texts.append(ComponentText(axis, value, spread, low, high, estimate.verdicts[i], limit))
    return tuple(texts)


def format_values(estimate: Estimate) -> str:
    """Format only the values, with names of components and without a unit: `x 0.0647, y −0.0005`."""
    return ", ".join(
        f"{figure.axis} {figure.limit or figure.value}".strip() for figure in figures(estimate)
    )


def significant(value: float, digits: int, sign: str = "") -> str:
    """Format with `digits` significant digits, without large powers of ten."""
    text = f"{value:{sign}.{digits}g}"
    return f"{value:{sign}.0f}" if "e+" in text else text


def rounded_columns(values: Array, stds: Array) -> tuple[list[str], list[str]]:
    """Format values and standard deviations (n,), each component with its own digits."""
    texts = [round_to_std(*pair) for pair in zip(values.tolist(), stds.tolist(), strict=True)]
    return [value for value, _ in texts], [std for _, std in texts]
