"""Chart parser: all derivations of a sentence, each span derived once.

Of a stretch that one name derives in several ways, the cheapest are kept: what is around it cannot
tell them apart.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass

from palpate.planning.request.sentence.grammar import Rule, Rules

Meanings = tuple[Hashable, ...]
Edges = Mapping[str, Sequence[tuple[int, Meanings]]]
"""Lattice edges that begin at one word: word or class, with end and meanings."""
Actions = Mapping[str, Callable[..., Hashable]]

MOST = 12
"""Readings of one stretch that are kept; a sentence with more is refused all the same, for two
suffice."""


@dataclass(slots=True)
class Found:
    """The cheapest readings of one stretch."""

    cost: int
    meanings: dict[Meanings, None]


Ends = dict[int, Found]


class Chart:
    """The derivations of one sentence.

    Attributes:
        furthest: how many of its words some derivation could make sense of.
    """

    def __init__(self, rules: Rules, actions: Actions, lattice: Sequence[Edges]) -> None:
        self.furthest = 0
        self._rules = rules
        self._actions = actions
        self._lattice = lattice
        self._begins = [*(frozenset(edges) for edges in lattice), frozenset[str]()]
        self._known: list[dict[str, Ends]] = [{} for _ in self._begins]

    def whole(self, name: str) -> list[Meanings]:
        """The cheapest readings of all of it."""
        found = self.derived(name, 0).get(len(self._lattice))
        return list(found.meanings) if found else []

    def derived(self, name: str, start: int) -> Ends:
        known = self._known[start]
        if name in known:
            return known[name]
        ends: Ends = {}
        for rule in self._rules.beginning(name, self._begins[start]):
            self._apply(rule, start, ends)
        known[name] = ends
        return ends

    def _apply(self, rule: Rule, start: int, ends: Ends) -> None:
        """Add what the rule derives from `start`."""
        so_far: Ends = {start: Found(rule.cost, {(): None})}
        for part in rule.parts:
            following: Ends = {}
            for at, before in so_far.items():
                for end, found in self._part(part, at).items():
                    _add_both(following, end, before, found)
            so_far = following
            if not so_far:
                return
        for end, found in so_far.items():
            if rule.action:
                found = Found(found.cost, dict.fromkeys(self._made(rule.action, found)))
            _add(ends, end, found)

    def _made(self, action: tuple[str, ...], found: Found) -> list[Meanings]:
        name, *arguments = action
        make = self._actions[name]
        made = [make(*arguments, *meanings) for meanings in found.meanings]
        return [one if isinstance(one, tuple) else (one,) for one in made]

    def _part(self, part: str, at: int) -> Ends:
        if part.startswith("<"):
            return self.derived(part, at)
        ends: Ends = {}
        if at < len(self._lattice):
            for end, meanings in self._lattice[at].get(part, ()):
                self.furthest = max(self.furthest, end)
                _add(ends, end, Found(0, {meanings: None}))
        return ends


def _add_both(ends: Ends, end: int, before: Found, after: Found) -> None:
    """Add what two stretches mean that stand one behind the other."""
    together = dict[Meanings, None]()
    for first in before.meanings:
        for second in after.meanings:
            together[(*first, *second)] = None
    _add(ends, end, Found(before.cost + after.cost, together))


def _add(ends: Ends, end: int, found: Found) -> None:
    known = ends.get(end)
    if known is None or found.cost < known.cost:
        ends[end] = Found(found.cost, dict(found.meanings))
    elif found.cost == known.cost and len(known.meanings) < MOST:
        known.meanings |= found.meanings
