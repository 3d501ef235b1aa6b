"""Answer to a question that compares: "is the novel heavier than the glass?", "which is the lightest?"."""

from __future__ import annotations

import math
import re
from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING

from palpate.estimation.estimate import Estimate, rounded
from palpate.estimation.fusion import Source, difference
from palpate.planning.request.wording import english

if TYPE_CHECKING:
    from palpate.runs.run import Run

LESS: Collection[str] = (
    *("lighter", "lightest", "lower", "lowest", "smaller", "smallest", "narrower", "thinner"),
    *("thinnest", "softer", "softest", "springier", "slipperier", "slipperiest"),
)
"""Comparing words that ask for the smaller value."""
CERTAIN = 1e-6
"""Probabilities below this are not told apart."""
UNCERTAIN = 0.05
"""Probability of the opposite order from which on a comparison stays open."""


@dataclass(frozen=True, slots=True)
class _Compared:
    """A compared object, with the estimate or the value that the scene states."""

    name: str
    value: float
    estimate: Estimate | None

    def __str__(self) -> str:
        if self.estimate is None:
            return f"{self.value:.4g}"
        return " ± ".join(rounded(self.value, float(self.estimate.stds[0])))


def answer(run: Run) -> str | None:
    """The answer to a comparing question, by the identified estimates; None where the request, in
    English, compares nothing. Values that the scene states are taken as exact."""
    asked = re.findall(r"[a-z]+", (run.settings.request or "").lower())
    word = next((word for word in asked if word in english().compared), None)
    if word is None or not run.estimates:
        return None
    quantity = english().compared[word]
    estimates = [each for each in run.estimates if each.parameter.quantity == quantity]
    if unknown := [each.parameter.object for each in estimates if not each.identified]:
        return f"open: the {quantity} of {' and '.join(unknown)} is not identified"
    compared = [_Compared(e.parameter.object, float(e), e) for e in estimates if len(e.values) == 1]
    compared += _stated(run, quantity, asked)
    if len(compared) < 2:
        return None
    compared.sort(key=lambda each: each.value, reverse=word not in LESS)
    first, second = compared[:2]
    unit = estimates[0].unit
    figures = f"{first.name} {first} against {second.name} {second}" + (f" {unit}" * (unit != "1"))
    chance = _chance(first, second)
    if chance > UNCERTAIN:
        return f"open: {figures}, too close to tell (p {chance:.2g})"
    certain = f"{figures} (p {chance:.1g})" if chance > CERTAIN else f"{figures} (p < {CERTAIN:g})"
    if word in english().superlatives or len(compared) > 2:
        return f"{first.name}: {certain}"
    return f"{'yes' if _subject(asked, compared) == first.name else 'no'}: {certain}"


def _stated(run: Run, quantity: str, asked: list[str]) -> list[_Compared]:
    """Objects of the request whose value the scene states."""
    measured = {estimate.parameter.object for estimate in run.estimates}
    found: list[_Compared] = []
    for name, body in run.scene.bodies.items():
        known = body.known.get(quantity)
        if known is not None and name not in measured and _place(name, asked) < len(asked):
            found.append(_Compared(name, known[0], None))
    return found


def _subject(asked: list[str], compared: list[_Compared]) -> str:
    """The object that the request names first: that of "is the novel heavier than the glass?"."""
    return min((each.name for each in compared), key=lambda name: _place(name, asked))


def _place(name: str, asked: list[str]) -> int:
    """Index of the last word of an object's name among the words of the request."""
    last = re.findall(r"[a-z]+", name.lower())[-1:]
    return asked.index(last[0]) if last and last[0] in asked else len(asked)


def _chance(first: _Compared, second: _Compared) -> float:
    """Probability that the order is the opposite; what both estimates share does not count."""
    if first.estimate is not None and second.estimate is not None:
        sources = [Source("", "this arm", one) for one in (first.estimate, second.estimate)]
        std = float(difference(*sources)[1][0])
    else:
        std = max(float(one.estimate.stds[0]) for one in (first, second) if one.estimate)
    return 0.5 * math.erfc(abs(first.value - second.value) / (std * math.sqrt(2.0)))
