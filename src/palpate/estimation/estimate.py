"""What an estimator returns: a value that knows how sure it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from palpate.parameter import Parameter
from palpate.trace.recording import Recording

Verdict = Literal["identified", "prior-dominated", "not identified"]


@dataclass(frozen=True, slots=True)
class Estimate:
    """A measured quantity.

    Attributes:
        value, std: one number per component, in the quantity's unit; empty when nothing is known.
        ci95: (low, high) per component.
        method: one sentence for people: what was done with which recordings.
        evidence: the recordings it rests on, for the report's plots.
        components: named further values, e.g. `{"static": (0.41, 0.02), "dynamic": (0.34, 0.01)}`
            as (value, std), or `{"single-shot": (0.262, 0.02)}` for comparison.
    """

    parameter: Parameter
    value: tuple[float, ...]
    std: tuple[float, ...]
    ci95: tuple[tuple[float, float], ...]
    method: str
    evidence: tuple[Recording, ...]
    verdict: Verdict = "identified"
    components: Mapping[str, tuple[float, float]] = field(
        default_factory=dict[str, tuple[float, float]]
    )


def not_identified(
    parameter: Parameter, method: str, evidence: tuple[Recording, ...] = ()
) -> Estimate:
    """The honest absence of an estimate: no value at all, and the reason in words."""
    return Estimate(parameter, (), (), (), method, evidence, "not identified")
