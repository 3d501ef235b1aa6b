"""The grammar of requests: `words/grammar.txt` as rules, and a chart that derives stretches with them.

Its notation: a name at the left edge, its alternatives under it, one a line. `<name>` is another
name, CAPITALS a class of words (`lattice`), small letters and punctuation a word. `[…]` may be
absent, `(…|…)` is one of several, `{…}` as often as it likes. `=> action` says what is made of the
meanings of the parts; without one they are passed on. `+1` is what an unlikely reading costs.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import cast

_SYMBOL = re.compile(r"<\w+>|=>|[\[\](){}|]|[^\s\[\](){}|]+")
_CLOSING = {"[": "]", "(": ")", "{": "}"}
MOST = 12
"""Readings of one stretch that are kept; a sentence with more is refused all the same, for two
suffice."""

Meanings = tuple[Hashable, ...]
Edges = Mapping[str, Sequence[tuple[int, Meanings]]]
"""Words and classes that begin at one place, with end and meanings."""
Actions = Mapping[str, Callable[..., Hashable]]


@dataclass(frozen=True, slots=True)
class Rule:
    """Alternative of a name: its parts, and what makes one meaning of theirs."""

    parts: tuple[str, ...]
    action: tuple[str, ...] = ()
    cost: int = 0


Rules = Mapping[str, Sequence[Rule]]


@dataclass(slots=True)
class Found:
    """The cheapest readings of one stretch."""

    cost: int
    meanings: dict[Meanings, None]


Ends = dict[int, Found]


class Chart:
    """The derivations of one sentence, each stretch derived once.

    Of a stretch that one name derives in several ways, the cheapest are kept.
    """

    def __init__(self, actions: Actions, lattice: Sequence[Edges]) -> None:
        self._actions = actions
        self._lattice = lattice
        self._known: list[dict[str, Ends]] = [{} for _ in [*lattice, None]]

    def derived(self, name: str, start: int) -> Ends:
        """Ends and readings of a name from a place."""
        if not name.startswith("<"):
            edges = self._lattice[start].get(name, ()) if start < len(self._lattice) else ()
            ends: Ends = {}
            for end, meanings in edges:
                _add(ends, end, Found(0, {meanings: None}))
            return ends
        known = self._known[start]
        if name not in known:
            known[name] = {}
            for rule in grammar()[name]:
                self._apply(rule, start, known[name])
        return known[name]

    def _apply(self, rule: Rule, start: int, ends: Ends) -> None:
        """Add what the rule derives from `start`."""
        so_far: Ends = {start: Found(rule.cost, {(): None})}
        for part in rule.parts:
            following: Ends = {}
            for at, before in so_far.items():
                for end, after in self.derived(part, at).items():
                    both = {(*a, *b): None for a in before.meanings for b in after.meanings}
                    _add(following, end, Found(before.cost + after.cost, both))
            so_far = following
            if not so_far:
                return
        for end, found in so_far.items():
            if rule.action:
                made = dict.fromkeys(self._made(rule.action, one) for one in found.meanings)
                found = Found(found.cost, made)
            _add(ends, end, found)

    def _made(self, action: tuple[str, ...], meanings: Meanings) -> Meanings:
        name, *arguments = action
        made = self._actions[name](*arguments, *meanings)
        return cast("Meanings", made) if isinstance(made, tuple) else (made,)


def _add(ends: Ends, end: int, found: Found) -> None:
    known = ends.get(end)
    if known is None or found.cost < known.cost:
        ends[end] = Found(found.cost, dict(found.meanings))
    elif found.cost == known.cost and len(known.meanings) < MOST:
        known.meanings |= found.meanings


@cache
def grammar() -> Rules:
    """The rules of `words/grammar.txt`, by name; a bracket becomes a name of its own."""
    text = files("palpate.planning.request").joinpath("words", "grammar.txt")
    rules: dict[str, list[Rule]] = {}
    name = ""
    for line in text.read_text(encoding="utf-8").splitlines():
        line = line.split("#", 1)[0].rstrip()
        if line.endswith(":") and not line.startswith(" "):
            name = f"<{line[:-1]}>"
            rules[name] = []
        elif line:
            said, _, price = line.partition(" +")
            said, _, action = said.partition("=>")
            (parts,) = _alternatives(_SYMBOL.findall(said), "", rules)
            rules[name].append(Rule(parts, tuple(action.split()), int(price or 0)))
    return rules


def _alternatives(
    symbols: list[str], closing: str, rules: dict[str, list[Rule]]
) -> list[tuple[str, ...]]:
    """Read up to `closing`; consumes `symbols`."""
    found: list[tuple[str, ...]] = []
    parts: list[str] = []
    while symbols:
        symbol = symbols.pop(0)
        if symbol == closing:
            break
        if symbol == "|":
            found.append(tuple(parts))
            parts = []
        elif symbol in _CLOSING:
            inside = _alternatives(symbols, _CLOSING[symbol], rules)
            name = f"<{symbol}{'|'.join(' '.join(one) for one in inside)}>"
            repeated = [Rule((*one, name) if symbol == "{" else one) for one in inside]
            rules[name] = repeated if symbol == "(" else [*repeated, Rule(())]
            parts.append(name)
        else:
            parts.append(symbol)
    return [*found, tuple(parts)]


@cache
def literals() -> frozenset[str]:
    """Words of the grammar itself."""
    parts = [part for rules in grammar().values() for rule in rules for part in rule.parts]
    return frozenset(part for part in parts if part.islower() and not part.startswith("<"))
