"""Answers to questions that compare or add up.

Examples are "is the novel heavier than the glass?", "which is the lightest?", "is the can heavier
than 400 g?" and "what do they weigh together?".
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from palpate.common.errors import InputError
from palpate.estimation.estimate import Estimate, interval95, round_to_std
from palpate.estimation.fusion import Source, weighted_sum
from palpate.estimation.quantities.within import parse_width
from palpate.planning.request.words import english, in_english, spoken

if TYPE_CHECKING:
    from palpate.runs.run import Run


# Comparing words that ask for the smaller value.
LESS: Collection[str] = (
    *("lighter", "lightest", "lower", "lowest", "smaller", "smallest", "narrower", "thinner"),
    *("thinnest", "softer", "softest", "springier", "slipperier", "slipperiest", "less", "least"),
)
UNNAMED = ("more", "most", "less", "least")  # Comparing words that name no quantity
# Words that make a question with one of `UNNAMED` a comparison.
CHOOSING = frozenset({"than", "which", "who", "what"})
# Words that ask for a sum.
TOGETHER = frozenset({"together", "total", "altogether", "combined", "sum"})
BELOW = ("under", "below", "most")
NEGATIONS = frozenset({"not", "no", "never"})
# First words of a question that is answered by yes or no.
ASKING = ("is", "are", "does", "do", "was", "were", "will", "would")
CERTAIN = 1e-6  # Smallest probability that is printed as a number
UNCERTAIN = 0.05  # Probability of the opposite order above which a comparison stays open
# Units as they are spelt in lower case, and in the plural with an s.
SPELT = {"gram": "g", "kilo": "kg", "kilogram": "kg", "n/m": "N/m", "n/mm": "kN/m"}
NUMBERS = {"half a": "0.5", "a": "1", "one": "1"}
_BOUND = re.compile(
    r"\b(?P<than>than|least|most|above|over|under|below|exceeds?) "
    rf"(?P<number>\d+(?:[.,]\d+)?|{'|'.join(NUMBERS)}) ?(?P<unit>n ?/ ?mm?|[a-z]+?)s?\b"
)
_ALIKE = re.compile(r"\b(?:equally|as (?!well |soon )\w+ as)\b")


@dataclass(frozen=True, slots=True)
class _Side:
    """Side of a comparison: the sum of the values of some objects, or an amount of the request."""

    name: str  # the objects; empty for an amount
    value: float  # sum, in SI units
    estimates: tuple[Estimate, ...] = ()  # the measured values in it; the others are exact

    def __str__(self) -> str:
        std = _std(self)
        figure = " ± ".join(round_to_std(self.value, std)) if std else f"{self.value:.4g}"
        return f"{self.name} {figure}".lstrip()


def answer(run: Run) -> str | None:
    """Answer a request that compares or adds up; None for other requests.

    The answer uses estimates that are identified or at a physical bound. Values that the scene
    states count as exact.
    """
    request = run.settings.request or ""
    names = frozenset(word for name in run.scene.bodies for word in _words(name))
    # Find the words that ask for a comparison, a sum or a bound.
    text = in_english(request, names, spoken(request))
    asked, compared, numbers = _words(text), english().compared, english().labels["numbers"]
    bound = _BOUND.search(re.sub("[a-z]+", lambda word: numbers.get(word[0], word[0]), text))
    unnamed = () if CHOOSING.isdisjoint(asked) else UNNAMED
    word = next((word for word in asked if word in compared or word in unnamed), "")
    together = not TOGETHER.isdisjoint(asked)
    if not (word or bound or together or _ALIKE.search(text)):
        return None
    # Determine the compared quantity and its estimates.
    measured = {estimate.parameter.quantity for estimate in run.estimates}
    quantity = compared.get(word) or (measured.pop() if len(measured) == 1 else "mass")
    estimates = [each for each in run.estimates if each.parameter.quantity == quantity]
    if not estimates:
        return None
    if unknown := [each.parameter.object for each in estimates if not each.is_evidence]:
        return f"open: the {quantity} of {' and '.join(unknown)} is not identified"
    # One side for each measured object, and for each object whose value the scene states.
    sides = [_Side(e.parameter.object, float(e), (e,)) for e in estimates if len(e.values) == 1]
    sides += _stated_objects(run, quantity, asked)
    unit = f" {estimates[0].unit}" * (estimates[0].unit != "1")
    # Add up: a sum alone is the answer, with its interval.
    if together:
        sides = _sum_sides(sides, asked)
        if len(sides) == 1 and bound is None:
            std = _std(sides[0])
            ends = interval95(sides[0].value, std)[0].tolist()
            interval = ", ".join(round_to_std(end, std)[0] for end in ends)
            return f"together: {sides[0]}{unit}, 95 % [{interval}]"
    # Compare each side with the amount in the request.
    if bound is not None:
        number = NUMBERS.get(bound["number"], bound["number"]).replace(",", ".")
        named = bound["unit"].replace(" ", "")
        try:
            amount = _Side("", parse_width(quantity, f"{number} {SPELT.get(named, named)}"))
        except InputError as error:
            return f"open: {error}"
        less = word in LESS if bound["than"] == "than" else bound["than"] in BELOW
        # A negated question gets no yes or no.
        has_subject, said = NEGATIONS.isdisjoint(asked), list[str]()
        for side in sides:
            first, second = sorted((side, amount), key=lambda each: each.value, reverse=not less)
            said.append(_word_answer(first, second, side.name if has_subject else None, unit))
        return "; ".join(said)
    if len(sides) < 2:
        return (
            f"open: no other {quantity} was measured than that of {estimates[0].parameter.object}"
        )
    # Compare the extreme side with the next one.
    sides.sort(key=lambda each: each.value, reverse=word not in LESS)
    if word:
        return _word_answer(sides[0], sides[1], _subject(sides, asked), unit)
    # Equality of two values cannot be shown: they differ, or the question stays open.
    return _word_answer(sides[0], sides[-1], "", unit, tails=2)


def _sum_sides(sides: Sequence[_Side], asked: Sequence[str]) -> list[_Side]:
    """Sum the sides before "than" and those after it."""
    # Sides after "than" belong to the second sum.
    than = asked.index("than") if "than" in asked else len(asked)
    sums: dict[bool, _Side] = {}
    for side in sides:
        is_behind = (_place(side.name, asked) or 0) > than
        before = sums.get(is_behind)
        if before is not None:
            name, parts = f"{before.name} and {side.name}", before.estimates + side.estimates
            side = _Side(name, before.value + side.value, parts)
        sums[is_behind] = side
    return list(sums.values())


def _word_answer(
    first: _Side, second: _Side, subject: str | None, unit: str, tails: int = 1
) -> str:
    """Word the order of two sides. With a `subject`, the answer is yes if it is the first side, else no."""
    figures = f"{first} against {second}{unit}"
    # Beyond the threshold the order stays open.
    chance = tails * _chance(first, second)
    if chance > UNCERTAIN:
        return f"open: {figures}, too close to tell (p {chance:.2g})"
    certain = f"{figures} (p {chance:.1g})" if chance > CERTAIN else f"{figures} (p < {CERTAIN:g})"
    if subject is None:
        return f"{first.name or second.name}: {certain}"
    return f"{'yes' if subject == first.name else 'no'}: {certain}"


def _stated_objects(run: Run, quantity: str, asked: Sequence[str]) -> list[_Side]:
    """Objects named in the request whose value the scene states."""
    # Measured values take precedence over stated ones.
    measured = {estimate.parameter.object for estimate in run.estimates}
    found: list[_Side] = []
    for name, body in run.scene.bodies.items():
        known = body.known.get(quantity)
        if known is not None and name not in measured and _place(name, asked) is not None:
            found.append(_Side(name, known[0]))
    return found


def _subject(compared: Sequence[_Side], asked: Sequence[str]) -> str | None:
    """Find the object before "than" in a question about two objects.

    None in other requests, and if the names are incomplete there, which leaves the sides uncertain.
    """
    # The subject is the only side before "than".
    places = {each.name: _place(each.name.split(" and ")[0], asked) for each in compared}
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


def _std(first: _Side, second: _Side | None = None) -> float:
    """Standard deviation of the first side, or of its difference from the second. Errors that both share cancel."""
    # Variance of a weighted sum with weights +1 and -1.
    plus, minus = first.estimates, second.estimates if second is not None else ()
    if not (plus or minus):
        return 0.0
    # All estimates are from one arm, so their shared errors correlate.
    sources = [Source("", "this arm", estimate) for estimate in (*plus, *minus)]
    weights = [1.0] * len(plus) + [-1.0] * len(minus)
    return float(weighted_sum(sources, weights)[1][0])


def _chance(first: _Side, second: _Side) -> float:
    """Probability of the opposite order.

    p = erfc(d / (σ √2)) / 2, with the difference d and its standard deviation σ.
    """
    apart, std = abs(first.value - second.value), _std(first, second)
    if std == 0.0:
        return 0.0 if apart > 0.0 else 0.5
    return 0.5 * math.erfc(apart / (std * math.sqrt(2.0)))
