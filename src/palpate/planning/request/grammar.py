"""Grammar of requests, and the meanings of its rules."""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from importlib.resources import files
from typing import cast

from palpate.planning.request.query import (
    AGAIN,
    Again,
    All,
    Except,
    Extreme,
    Kind,
    Mention,
    NamedPurpose,
    NamedQuantity,
    Names,
    Near,
    Need,
    Query,
    Say,
    Selector,
    Several,
)
from palpate.planning.request.selection import OBJECT_NOUNS

_SYMBOL = re.compile(r"<\w+>|=>|[\[\](){}|]|[^\s\[\](){}|]+")
_CLOSING = {"[": "]", "(": ")", "{": "}"}
MOST = 12
"""Maximum number of readings per stretch. Two different ones already make a sentence ambiguous."""

Meanings = tuple[Hashable, ...]
Edges = Mapping[str, Sequence[tuple[int, Meanings]]]
"""Words and classes that begin at one position, with end and meanings."""
Actions = Mapping[str, Callable[..., Hashable]]


@dataclass(frozen=True, slots=True)
class GrammarRule:
    """Alternative of a symbol: its parts, and the action that combines their meanings."""

    parts: tuple[str, ...]
    action: tuple[str, ...] = ()
    cost: int = 0


Rules = Mapping[str, Sequence[GrammarRule]]


@dataclass(slots=True)
class CheapestReadings:
    """Cheapest readings of one stretch."""

    cost: int
    meanings: dict[Meanings, None]


Ends = dict[int, CheapestReadings]


class DerivationChart:
    """Chart of the derivations of one sentence; each stretch is derived once.

    If a symbol derives a stretch in several ways, the cheapest are kept.
    """

    def __init__(self, actions: Actions, lattice: Sequence[Edges]) -> None:
        self._actions = actions
        self._lattice = lattice
        self._known: list[dict[str, Ends]] = [{} for _ in [*lattice, None]]

    def derived(self, name: str, start: int) -> Ends:
        """Return the ends and readings of a symbol from a position."""
        if not name.startswith("<"):
            # A terminal: its readings come from the lattice.
            edges = self._lattice[start].get(name, ()) if start < len(self._lattice) else ()
            ends: Ends = {}
            for end, meanings in edges:
                _add(ends, end, CheapestReadings(0, {meanings: None}))
            return ends
        # Store the entry before the rules are applied, so that a left recursion ends.
        known = self._known[start]
        if name not in known:
            known[name] = {}
            for rule in grammar()[name]:
                self._apply(rule, start, known[name])
        return known[name]

    def _apply(self, rule: GrammarRule, start: int, ends: Ends) -> None:
        """Add the derivations of a rule from `start`."""
        # Extend the partial readings part by part; costs add up and meanings multiply.
        so_far: Ends = {start: CheapestReadings(rule.cost, {(): None})}
        for part in rule.parts:
            following: Ends = {}
            for at, before in so_far.items():
                for end, after in self.derived(part, at).items():
                    # Cartesian product of the meanings before and after.
                    both = {(*a, *b): None for a in before.meanings for b in after.meanings}
                    _add(following, end, CheapestReadings(before.cost + after.cost, both))
            so_far = following
            if not so_far:
                return
        # Combine the meanings of the parts by the action of the rule.
        for end, found in so_far.items():
            if rule.action:
                made = dict.fromkeys(self._apply_action(rule.action, one) for one in found.meanings)
                found = CheapestReadings(found.cost, made)
            _add(ends, end, found)

    def _apply_action(self, action: tuple[str, ...], meanings: Meanings) -> Meanings:
        # The action may have constant arguments before the meanings.
        name, *arguments = action
        made = self._actions[name](*arguments, *meanings)
        return cast("Meanings", made) if isinstance(made, tuple) else (made,)


def _add(ends: Ends, end: int, found: CheapestReadings) -> None:
    """Keep the cheaper readings of an end, or merge those of equal cost."""
    known = ends.get(end)
    if known is None or found.cost < known.cost:
        ends[end] = CheapestReadings(found.cost, dict(found.meanings))
    elif found.cost == known.cost and len(known.meanings) < MOST:
        known.meanings |= found.meanings


@cache
def grammar() -> Rules:
    """Return the rules of `words/grammar.txt` by name; a bracket becomes a symbol with a generated
    name.
    """
    text = files("palpate.planning.request").joinpath("words", "grammar.txt")
    rules: dict[str, list[GrammarRule]] = {}
    name = ""
    for line in text.read_text(encoding="utf-8").splitlines():
        line = line.split("#", 1)[0].rstrip()
        # A header line names the symbol of the rules below it.
        if line.endswith(":") and not line.startswith(" "):
            name = f"<{line[:-1]}>"
            rules[name] = []
        elif line:
            # A rule line: parts, action after "=>", cost after " +".
            said, _, price = line.partition(" +")
            said, _, action = said.partition("=>")
            (parts,) = _alternatives(_SYMBOL.findall(said), "", rules)
            rules[name].append(GrammarRule(parts, tuple(action.split()), int(price or 0)))
    return rules


def _alternatives(
    symbols: list[str], closing: str, rules: dict[str, list[GrammarRule]]
) -> list[tuple[str, ...]]:
    """Parse alternatives up to `closing`; consumes `symbols`."""
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
            # ( ) groups, [ ] is optional, { } repeats: the last two also derive nothing.
            inside = _alternatives(symbols, _CLOSING[symbol], rules)
            name = f"<{symbol}{'|'.join(' '.join(one) for one in inside)}>"
            repeated = [GrammarRule((*one, name) if symbol == "{" else one) for one in inside]
            rules[name] = repeated if symbol == "(" else [*repeated, GrammarRule(())]
            parts.append(name)
        else:
            parts.append(symbol)
    return [*found, tuple(parts)]


@cache
def literals() -> frozenset[str]:
    """Return the literal words of the grammar."""
    # Lower-case parts are literal words; others are symbols or classes.
    parts = [part for rules in grammar().values() for rule in rules for part in rule.parts]
    return frozenset(part for part in parts if part.islower() and not part.startswith("<"))


# Actions of the grammar: functions behind `=> action`, from the meanings of the parts to that of
# the rule.


Words = tuple[str, ...]
Part = NamedQuantity | Selector | str
"""Quantity, quantity id, or selector."""


def _kind(*parts: str | Words) -> Kind:
    """All bodies of a noun, with their number if stated."""
    (words,) = (part for part in parts if not isinstance(part, str))
    return Kind(words, next((part for part in parts if isinstance(part, str)), ""))


def _extreme(*parts: str | Words) -> Extreme:
    """ "The left box", "the box farthest to the left"."""
    return Extreme(_kind(*(part for part in parts if not isinstance(part, str))), _last(parts))


def _last(parts: tuple[str | Words, ...]) -> str:
    return [part for part in parts if isinstance(part, str)][-1]


def _several(*parts: Selector) -> Selector:
    return parts[0] if len(parts) == 1 else Several(parts)


def _choice(*parts: Selector) -> Several:
    return Several(parts, choice=True)


def _all_of(selector: Selector) -> Selector:
    """Replace a choice by all of its parts."""
    return Several(selector.parts) if isinstance(selector, Several) else selector


def _each(selector: Selector) -> Selector:
    """Select all bodies of a kind for a comparison: "the heaviest box", "which box"."""
    match selector:
        case Names(words, bare) if bare or words[-1] in OBJECT_NOUNS:
            return Kind(words)
        case Near():
            return Near(_each(selector.base), selector.relation, selector.marks)
        case Several():
            return Several(tuple(map(_each, selector.parts)))
        case _:
            return selector


def _less(base: Selector, less: Selector) -> Except:
    return Except(base, _all_of(less))


def _marks(relation: str, *marks: Selector) -> tuple[Hashable, ...]:
    return relation, marks


def _near(base: Selector, relation: str, marks: tuple[Selector, ...]) -> Near:
    return Near(base, relation, marks)


def _top(base: Selector) -> Near:
    """ "The top of the table": for a surface the body itself, for anything else a part."""
    return Near(base, "top", ())


def _quantities(parts: tuple[Part, ...]) -> tuple[NamedQuantity, ...]:
    # A plain text is the id of a quantity.
    found = [NamedQuantity(part, part) if isinstance(part, str) else part for part in parts]
    return tuple(dict.fromkeys(part for part in found if isinstance(part, NamedQuantity)))


def _selectors(parts: tuple[Part, ...]) -> tuple[Selector, ...]:
    return tuple(part for part in parts if not isinstance(part, (NamedQuantity, str)))


def _of(*parts: Part) -> tuple[Query, ...]:
    selector = next(iter(_selectors(parts)), None)
    return tuple(Query(quantity, selector) for quantity in _quantities(parts))


def _how_large(asked: NamedQuantity, *parts: Part) -> tuple[Query, ...]:
    """ "How high is the friction"; for a centre of mass, its third axis."""
    # "How high" means the vertical component of a centre of mass.
    named = _quantities(parts)
    if asked.id == "height" and any(quantity.id == "com" for quantity in named):
        named = _quantities(("com_3d",))
    return _of(*(named or (asked,)), *_selectors(parts))


def _every(*quantities: NamedQuantity) -> tuple[Query, ...]:
    return tuple(Query(quantity, every=True) for quantity in quantities)


def _that(selector: Selector) -> Query:
    return Query(AGAIN, selector)


def _say(how: str, *parts: Query | NamedQuantity) -> Say:
    """Combine queries. A quantity without a selector takes that of the next query.

    Example: "neither the mass nor the friction of the mug".
    """
    # Go backwards, so that the next selector is known.
    queries: list[Query] = []
    selector: Selector | None = None
    for part in reversed(parts):
        queries.insert(0, Query(part, selector) if isinstance(part, NamedQuantity) else part)
        selector = queries[0].selector
    return Say(how, tuple(queries))


def _repeat(how: str, *selectors: Selector) -> Say:
    return Say(how, tuple(map(_that, selectors)))


def _exclude(*selectors: Selector) -> Say:
    return Say("skip", tuple(Query(None, _all_of(selector)) for selector in selectors))


def _no(*quantities: NamedQuantity) -> Say:
    return Say("skip", _every(*quantities))


def _mark_known(*parts: Part) -> Say:
    return Say("know", _of(*parts))


def _missing(selector: Selector | None = None) -> Say:
    return Say("want", (Query(None, selector),))


def _compare(*parts: Part) -> Say:
    """Request the quantity of all compared bodies; of all bodies if none is named."""
    # A comparison needs all candidates, not a single one.
    selectors = tuple(map(_each, _selectors(parts))) or (Again("all"),)
    return Say("want", _of(*_quantities(parts)[:1], _several(*selectors)))


def _purpose(*parts: str | Selector) -> NamedPurpose:
    (selector,) = (part for part in parts if not isinstance(part, str))
    return NamedPurpose(next(part for part in parts if isinstance(part, str)), selector)


def _need(*_: Hashable) -> Need:
    return Need()


def _nothing(*_: Hashable) -> tuple[()]:
    return ()


ACTIONS: Mapping[str, Callable[..., Hashable]] = {
    "names": Names,
    "name": partial(Names, bare=True),
    "kind": _kind,
    "number": partial(Kind, ("object",)),
    "one": partial(Again, "one"),
    "extreme": _extreme,
    "again": Again,
    "all": All,
    "others": partial(All, others=True),
    "several": _several,
    "choice": _choice,
    "less": _less,
    "all_less": partial(_less, All()),
    "marks": _marks,
    "near": _near,
    "near_any": partial(_near, All()),
    "top": _top,
    "of": _of,
    "how_large": _how_large,
    "how_high": partial(_how_large, NamedQuantity("height", "high")),
    "its": partial(_of, Again("it")),
    "that": _that,
    "every": _every,
    "mass": partial(NamedQuantity, "mass", "mass"),
    "inertial": partial(_quantities, ("mass", "com", "inertia")),
    "missing": _missing,
    "say": _say,
    "about": partial(_repeat, "about"),
    "also": partial(_repeat, "also"),
    "exclude": _exclude,
    "no": _no,
    "known": _mark_known,
    "compared": _compare,
    "mention": Mention,
    "alone": partial(Mention, alone=True),
    "purpose": _purpose,
    "need": _need,
    "nothing": _nothing,
}
