"""Answers to questions that compare or add up.

Examples are "is the novel heavier than the glass?", "which is the lightest?", "is the can heavier
than 400 g?" and "what do they weigh together?".
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from palpate.common.errors import InputError
from palpate.common.parameter import PlanRejected
from palpate.estimation.estimate import Estimate, interval95, round_to_std
from palpate.estimation.evidence import once
from palpate.estimation.fusion import Source, weighted_sum
from palpate.estimation.quantities.within import parse_width
from palpate.planning.request.grounding import parse
from palpate.planning.request.words import amount as amount_of
from palpate.runs.run import Run
from palpate.scene.scene import Scene

# First words of a question that is answered by yes or no.
ASKING = ("is", "are", "does", "do", "ist", "sind", "wiegt", "est", "è", "pesa")
LEAST_PROBABILITY = 1e-6  # Smallest probability that is printed as a number
UNCERTAIN = 0.05  # Probability of the opposite order above which a comparison stays open


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
    # Find the words that ask for a comparison, a sum or a bound.
    asked = _comparison(run)
    if asked is None:
        return None
    # Determine the compared quantity and its estimates.
    measured = {estimate.parameter.quantity for estimate in run.estimates}
    quantity = asked.quantity or (measured.pop() if len(measured) == 1 else "mass")
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
    if asked.together:
        sides = _sum_sides(sides, asked)
        if len(sides) == 1 and asked.bound is None:
            std = _std(sides[0])
            ends = interval95(sides[0].value, std)[0].tolist()
            interval = ", ".join(round_to_std(end, std)[0] for end in ends)
            return f"together: {sides[0]}{unit}, 95 % [{interval}]"
    # Compare each side with the amount in the request.
    if asked.bound is not None:
        try:
            amount = _Side("", parse_width(quantity, asked.bound))
        except InputError as error:
            return f"open: {error}"
        return "; ".join(_compare_with_amount(side, amount, asked, unit) for side in sides)
    if len(sides) < 2:
        return (
            f"open: no other {quantity} was measured than that of {estimates[0].parameter.object}"
        )
    # Compare the extreme side with the next one.
    sides.sort(key=lambda each: each.value, reverse=not asked.less)
    if asked.orders:
        return _word_answer(sides[0], sides[1], _subject(sides, asked), unit)
    # Equality of two values cannot be shown: they differ, or the question stays open.
    return _word_answer(sides[0], sides[-1], "", unit, tails=2)


def has_comparison(run: Run) -> bool:
    """True for a request that compares or adds up."""
    return _comparison(run) is not None


@dataclass(frozen=True, slots=True)
class _Comparison:
    """Words of a request that compare or add up."""

    quantity: str | None  # the compared one; None if the words name none
    orders: bool  # it asks for an order, not for equality
    less: bool  # it asks for the smaller value, or for a value below the bound
    together: bool  # it asks for a sum
    bound: str | None  # amount of the request, as `0.5 kg`
    negated: bool
    asks: bool  # a question that is answered by yes or no
    places: Mapping[str, int]  # position of each named object among the words
    than: int  # position of "than"


def _comparison(run: Run) -> _Comparison | None:
    return _comparison_of(run.scene, run.settings.request or "-")


@once
def _comparison_of(scene: Scene, request: str) -> _Comparison | None:
    """Return the comparison that a request asks for; None without one."""
    try:
        _, sentences = parse(request, scene)
    except PlanRejected:
        return None
    spots = [spot for sentence in sentences for spot in sentence.spots]
    words = [word for sentence in sentences for word in sentence.words]

    def first(*names: str) -> int | None:
        return next((at for at, spot in enumerate(spots) if spot.has(*names)), None)

    # An amount after a comparative is a bound.
    amounts = [at for at, spot in enumerate(spots) if spot.has("AMOUNT")]
    limits = [
        at
        for at in amounts
        if any(o.has("THAN", "ABOVE", "BELOW") for o in spots[max(0, at - 2) : at])
    ]
    bound = spots[limits[0]].classes["AMOUNT"].replace("~", " ") if limits else None
    than = first("THAN", "ABOVE", "BELOW")
    # A word without a quantity compares only with "than" or "which".
    choosing = than is not None or first("WHICH") is not None
    comparative = first("C")
    plain = first("MORE") if choosing else None
    equal = first("EQUAL") is not None or sum(spot.has("THAN") for spot in spots) > 1
    together = first("TOGETHER") is not None
    orders = comparative is not None or (plain is not None and not equal)
    if not (orders or bound or together or (equal and first("A", "N", "W") is not None)):
        return None
    # "Less" and "at most" turn the order.
    less = first("LESS") is not None
    if limits and any(o.has("ABOVE", "BELOW") for o in spots[max(0, limits[0] - 2) : limits[0]]):
        less = any(o.has("BELOW") for o in spots[max(0, limits[0] - 2) : limits[0]])
    names = [n for n in ("C", "N", "A", "W") for spot in spots if spot.classes.get(n)]
    named = next((spot.classes[names[0]] for spot in spots if names and spot.has(names[0])), None)
    places = {
        name: at
        for at, spot in reversed(list(enumerate(spots)))
        if spot.thing is not None
        and (len(spot.thing.names) == 1 or spot.thing.plural)
        and spot.thing.names != tuple(scene.objects)
        for name in spot.thing.names
    }
    return _Comparison(
        quantity=spots[comparative].classes["C"] if comparative is not None else named,
        orders=orders,
        less=less,
        together=together,
        bound=amount_of(bound) if bound else None,
        negated=first("NOT") is not None,
        asks=bool(words) and words[0] in ASKING,
        places=places,
        than=len(spots) if than is None else than,
    )


def _compare_with_amount(side: _Side, amount: _Side, asked: _Comparison, unit: str) -> str:
    """Compare a side with an amount; a negated question gets no yes or no."""
    first, second = sorted((side, amount), key=lambda each: each.value, reverse=not asked.less)
    return _word_answer(first, second, None if asked.negated else side.name, unit)


def _sum_sides(sides: Sequence[_Side], asked: _Comparison) -> list[_Side]:
    """Sum the sides before "than" and those after it."""
    sums: dict[bool, _Side] = {}
    for side in sides:
        is_behind = asked.places.get(side.name, 0) > asked.than
        before = sums.get(is_behind)
        if before is not None:
            name, parts = f"{before.name} and {side.name}", before.estimates + side.estimates
            side = _Side(name, before.value + side.value, parts)
        sums[is_behind] = side
    return list(sums.values())


def _word_answer(
    first: _Side, second: _Side, subject: str | None, unit: str, tails: int = 1
) -> str:
    """Word the order of two sides. With a `subject`, the answer is yes if it is the first side,
    else no.
    """
    figures = f"{first} against {second}{unit}"
    # Beyond the threshold the order stays open.
    chance = tails * _chance(first, second)
    if chance > UNCERTAIN:
        return f"open: {figures}, too close to tell (p {chance:.2g})"
    certain = (
        f"{figures} (p {chance:.1g})"
        if chance > LEAST_PROBABILITY
        else f"{figures} (p < {LEAST_PROBABILITY:g})"
    )
    if subject is None:
        return f"{first.name or second.name}: {certain}"
    return f"{'yes' if subject == first.name else 'no'}: {certain}"


def _stated_objects(run: Run, quantity: str, asked: _Comparison) -> list[_Side]:
    """Objects named in the request whose value the scene states."""
    # Measured values take precedence over stated ones.
    measured = {estimate.parameter.object for estimate in run.estimates}
    sides: list[_Side] = []
    for name, body in run.scene.bodies.items():
        known = body.known.get(quantity)
        if known is not None and name not in measured and name in asked.places:
            sides.append(_Side(name, known[0]))
    return sides


def _subject(compared: Sequence[_Side], asked: _Comparison) -> str | None:
    """Find the object before "than" in a question about two objects.

    None in other requests, and if the objects are not named, which leaves the sides uncertain.
    """
    if not asked.asks or len(compared) > 2:
        return None
    places = {each.name: asked.places.get(each.name.split(" and ")[0]) for each in compared}
    before = [name for name, place in places.items() if place is not None and place < asked.than]
    after = [name for name, place in places.items() if place is not None and place > asked.than]
    return before[0] if len(before) == len(after) == 1 else None


def _std(first: _Side, second: _Side | None = None) -> float:
    """Standard deviation of the first side, or of its difference from the second. Errors that both
    share cancel.
    """
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
    difference, std = abs(first.value - second.value), _std(first, second)
    if std == 0.0:
        return 0.0 if difference > 0.0 else 0.5
    return 0.5 * math.erfc(difference / (std * math.sqrt(2.0)))
