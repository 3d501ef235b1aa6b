"""Answer to a question that compares: "is the novel heavier than the glass?", "which is the lightest?"."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Sequence
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
ASKING = ("is", "are", "does", "do", "was", "were", "will", "would")
"""First words of a question that is answered by yes or no."""
CERTAIN = 1e-6
"""Smallest probability that is printed as a number."""
UNCERTAIN = 0.05
"""Probability of the opposite order above which a comparison stays open."""


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
    """Answer an English request that compares, from the identified estimates; None if it compares
    nothing that was measured. Values stated by the scene count as exact."""
    asked = _words(run.settings.request or "")
    word = next((word for word in asked if word in english().compared), None)
    if word is None:
        return None
    quantity = english().compared[word]
    estimates = [each for each in run.estimates if each.parameter.quantity == quantity]
    if not estimates:
        return None
    if unknown := [each.parameter.object for each in estimates if not each.identified]:
        return f"open: the {quantity} of {' and '.join(unknown)} is not identified"
    compared = [_Compared(e.parameter.object, float(e), e) for e in estimates if len(e.values) == 1]
    compared += _stated(run, quantity, asked)
    if len(compared) < 2:
        return None
    compared.sort(key=lambda each: each.value, reverse=word not in LESS)
    return _worded(compared, asked, estimates[0].unit)


def _worded(compared: Sequence[_Compared], asked: Sequence[str], unit: str) -> str:
    """Word the answer from the first two of the sorted objects."""
    first, second = compared[:2]
    figures = f"{first.name} {first} against {second.name} {second}" + (f" {unit}" * (unit != "1"))
    chance = _chance(first, second)
    if chance > UNCERTAIN:
        return f"open: {figures}, too close to tell (p {chance:.2g})"
    certain = f"{figures} (p {chance:.1g})" if chance > CERTAIN else f"{figures} (p < {CERTAIN:g})"
    subject = _subject(compared, asked)
    if subject is None:
        return f"{first.name}: {certain}"
    return f"{'yes' if subject == first.name else 'no'}: {certain}"


def _stated(run: Run, quantity: str, asked: Sequence[str]) -> list[_Compared]:
    """Objects named in the request whose value the scene states."""
    measured = {estimate.parameter.object for estimate in run.estimates}
    found: list[_Compared] = []
    for name, body in run.scene.bodies.items():
        known = body.known.get(quantity)
        if known is not None and name not in measured and _place(name, asked) is not None:
            found.append(_Compared(name, known[0], None))
    return found


def _subject(compared: Sequence[_Compared], asked: Sequence[str]) -> str | None:
    """Object before "than" in a question about two; None in other requests, or if the names do not
    stand there in full, which leaves the sides uncertain."""
    places = {each.name: _place(each.name, asked) for each in compared}
    than = asked.index("than") if "than" in asked and asked[0] in ASKING else None
    if than is None or len(compared) > 2:
        return None
    before = [name for name, place in places.items() if place is not None and place < than]
    after = [name for name, place in places.items() if place is not None and place > than]
    return before[0] if len(before) == len(after) == 1 else None


def _place(name: str, asked: Sequence[str]) -> int | None:
    """Index of an object's full name among the words of the request, or None."""
    parts = _words(name)
    for i in range(len(asked) - len(parts) + 1):
        if parts and list(asked[i : i + len(parts)]) == parts:
            return i
    return None


def _words(text: str) -> list[str]:
    return re.findall(r"[a-z0-9]+", text.lower())


def _chance(first: _Compared, second: _Compared) -> float:
    """Probability of the opposite order, p = erfc(d / (σ √2)) / 2 with the difference d and its std σ."""
    estimates = [each.estimate for each in (first, second) if each.estimate is not None]
    if len(estimates) == 2:
        # Errors that both estimates share cancel in the difference.
        sources = [Source("", "this arm", estimate) for estimate in estimates]
        std = float(difference(*sources)[1][0])
    else:
        std = max((float(estimate.stds[0]) for estimate in estimates), default=0.0)
    apart = abs(first.value - second.value)
    if std == 0.0:
        return 0.0 if apart > 0.0 else 0.5
    return 0.5 * math.erfc(apart / (std * math.sqrt(2.0)))
