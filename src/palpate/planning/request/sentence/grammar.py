"""The grammar of requests: `words/grammar.txt` as rules that a chart derives sentences with.

Its notation: a name at the left edge, its alternatives under it, one a line. `<name>` is another
name, CAPITALS a class of words (`lattice`), small letters and punctuation a word. `[…]` may be
absent, `(…|…)` is one of several, `{…}` as often as it likes. `=> action` says what is made of the
meanings of the parts; without one they are passed on. `+1` is what an unlikely reading costs.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

_SYMBOL = re.compile(r"<\w+>|=>|[\[\](){}|]|[^\s\[\](){}|]+")
_CLOSING = {"[": "]", "(": ")", "{": "}"}


@dataclass(frozen=True, slots=True)
class Rule:
    """Alternative of a nonterminal.

    Attributes:
        parts: names in `<>`, classes of words, and words.
        action: what makes one meaning of those of the parts; with its own arguments. None of it passes
            them on.
    """

    parts: tuple[str, ...]
    action: tuple[str, ...] = ()
    cost: int = 0


class Rules:
    """The alternatives of every name, none of which begins with that name itself."""

    def __init__(self, named: Mapping[str, Sequence[Rule]]) -> None:
        self.named = named
        self._begins: dict[str, tuple[frozenset[str], bool]] = {}
        self._first: dict[str, tuple[tuple[Rule, frozenset[str] | None], ...]] = {}

    def beginning(self, name: str, symbols: frozenset[str]) -> Iterator[Rule]:
        """The alternatives of a name that may begin with one of `symbols`, or be nothing."""
        for rule, first in self._alternatives(name):
            if first is None or not first.isdisjoint(symbols):
                yield rule

    def _alternatives(self, name: str) -> tuple[tuple[Rule, frozenset[str] | None], ...]:
        """Alternatives of a nonterminal, with their first symbols; None if it may be empty."""
        if name not in self._first:
            told = ((rule, *self._begin(rule.parts)) for rule in self.named[name])
            self._first[name] = tuple(
                (rule, None if empty else first) for rule, first, empty in told
            )
        return self._first[name]

    def _begin(self, parts: Sequence[str]) -> tuple[frozenset[str], bool]:
        """First symbols of a sequence, and whether it may be empty."""
        found = frozenset[str]()
        for part in parts:
            first, empty = self._begin_of(part)
            found |= first
            if not empty:
                return found, False
        return found, True

    def _begin_of(self, part: str) -> tuple[frozenset[str], bool]:
        if not part.startswith("<"):
            return frozenset({part}), False
        if part not in self._begins:
            told = [self._begin(rule.parts) for rule in self.named[part]]
            first = frozenset[str]().union(*(symbols for symbols, _ in told))
            self._begins[part] = first, any(empty for _, empty in told)
        return self._begins[part]


@cache
def grammar() -> Rules:
    """The rules of `words/grammar.txt`, by name."""
    text = files("palpate.planning.request").joinpath("words", "grammar.txt")
    return _Reader(text.read_text(encoding="utf-8")).rules()


class _Reader:
    """Reader of the notation; a bracket becomes a nonterminal."""

    def __init__(self, text: str) -> None:
        self._rules: dict[str, list[Rule]] = {}
        name = ""
        for line in text.splitlines():
            line = line.split("#", 1)[0].rstrip()
            if line.endswith(":") and not line.startswith(" "):
                name = f"<{line[:-1]}>"
                self._rules.setdefault(name, [])
            elif line:
                self._rules[name].append(self._rule(line))

    def rules(self) -> Rules:
        """All of them."""
        return Rules(self._rules)

    def _rule(self, line: str) -> Rule:
        cost = 0
        priced = re.search(r" \+(\d+)$", line)
        if priced:
            cost, line = int(priced[1]), line[: priced.start()]
        said, _, action = line.partition("=>")
        symbols = _SYMBOL.findall(said)
        (parts,) = self._alternatives(symbols, "")
        return Rule(parts, tuple(action.split()), cost)

    def _alternatives(self, symbols: list[str], closing: str) -> list[tuple[str, ...]]:
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
                parts.append(self._bracket(symbol, symbols))
            else:
                parts.append(symbol)
        return [*found, tuple(parts)]

    def _bracket(self, opening: str, symbols: list[str]) -> str:
        inside = self._alternatives(symbols, _CLOSING[opening])
        name = f"<{opening}{'|'.join(' '.join(parts) for parts in inside)}>"
        if opening == "{":
            inside = [(*parts, name) for parts in inside]
        rules = [Rule(parts) for parts in inside]
        self._rules[name] = rules if opening == "(" else [*rules, Rule(())]
        return name
