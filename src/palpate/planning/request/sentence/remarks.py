"""Side remarks that do not change a request: "a customer is waiting".

No word of it may name a thing of the scene or a property, or say what is wanted, known or left out
(`telling` in `words/en.yaml`). Nobody looks into it: it is named in a remark, and nothing said later
may lean on it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from palpate.planning.request.sentence.chart import Meanings
from palpate.planning.request.wording import english

Judged = Callable[[Sequence[str], int], bool]
"""Test of the word at one place."""

_REASONS = frozenset({"because", "since", "as", "before", "although", "though", "while"})
"""First words of clauses of reason or time."""
_APART = frozenset({",", "and", "so", "but", "which", "who", "that", "?"}) | _REASONS
"""Words that separate a side remark."""
_PURPOSES = frozenset({("so", "that"), ("now", "that")})
_BEGINS = frozenset({"i", "we", "please"})
"""First words of a request behind a remark."""
_NAMING = frozenset({"the", "my", "our", "this", "that", "a", "an", "some", "his", "her", "their"})
"""Determiners."""
_WORDS = 3
"""Words of the shortest remark that is a sentence."""


def remarks(
    tokens: Sequence[str], at: int, says_nothing: Judged, bears: Judged, asks: Judged
) -> Iterator[tuple[str, int, Meanings]]:
    """Remarks that begin at one word: a sentence (REMARK), a relative clause (SAYING, REST), a
    reason (WHY), a statement on the thing before (TELLS)."""
    before = tokens[at - 1] if at else ","
    if before not in _NAMING:
        yield from _sayings(tokens, at, says_nothing)
    for end in _ends(tokens, at, says_nothing):
        said = (" ".join(tokens[at:end]),)
        following = (*tokens, ",")[end]
        if at and following in _APART:
            yield "TELLS", end, said
        if before not in _APART:
            continue
        yield "REST", end, said
        if end - at >= _WORDS and tokens[at] in english().remarking:
            yield "REMARK", end, said
    if _reasoned(tokens, at):
        for end in _ends(tokens, at, bears):
            yield "WHY", end, (" ".join(tokens[at:end]),)
    if _reasoned(tokens, at) and not any(asks(tokens, i) for i in range(at, len(tokens))):
        yield "REST", len(tokens), (" ".join(tokens[at:]),)


def _sayings(
    tokens: Sequence[str], at: int, says_nothing: Judged
) -> Iterator[tuple[str, int, Meanings]]:
    """Remarks on the thing that is named next, and on no other (SAYING)."""
    for end in range(at + 1, min(at + _WORDS, len(tokens))):
        if tokens[end - 1] in _NAMING or not says_nothing(tokens, end - 1):
            return
        if tokens[end] in _NAMING:
            yield "SAYING", end, (" ".join(tokens[at:end]),)


def _reasoned(tokens: Sequence[str], at: int) -> bool:
    """Test that a clause of reason or time begins here."""
    before = tuple(tokens[max(at - 2, 0) : at])
    return before[-1:] != () and (before[-1] in _REASONS or before in _PURPOSES)


def _ends(tokens: Sequence[str], at: int, says_nothing: Judged) -> Iterator[int]:
    """Ends of remarks that begin here."""
    for end in range(at + 1, len(tokens) + 1):
        if not says_nothing(tokens, end - 1):
            return
        if end == len(tokens) or tokens[end] in _APART or tokens[end] in _BEGINS:
            yield end
