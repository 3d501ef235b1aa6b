"""Misspelt words of a request, read as the words of properties and things that they come near."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from difflib import SequenceMatcher

SHORTEST = 4
"""Letters: a shorter word is near too many others."""
NEAR = 0.82
"""Share of the letters that must be the same and in order. Nobody's slip changes the first letter;
a cable is no table."""


def meant(word: str, known: Collection[str]) -> str | None:
    """The one of `known` that `word` is a slip of, None where there is none, or no single one."""
    if not word.isalpha():
        return None
    doubled = [other for other in known if len(other) > 3 and _single(other) == _single(word)]
    if doubled:
        return doubled[0] if len(doubled) == 1 else None
    if len(word) < SHORTEST:
        return None
    found = _nearest(word, (other for other in known if other[0] == word[0]))
    return found[0] if len(found) == 1 else None


def _nearest(word: str, known: Iterable[str]) -> list[str]:
    """Those of `known` that are the nearest, if they are near at all."""
    best, nearest = NEAR, list[str]()
    for other in known:
        if abs(len(other) - len(word)) > 2:
            continue
        same = _alike(word, other)
        if same > best:
            best, nearest = same, [other]
        elif same == best:
            nearest.append(other)
    return nearest


def _alike(word: str, other: str) -> float:
    """From 0 to 1. Two letters that changed places are one slip."""
    if sorted(word) == sorted(other):
        return 1.0
    return SequenceMatcher(None, word, other, autojunk=False).ratio()


def _single(word: str) -> str:
    """A word without its doubled letters: "mas" is a slip of "mass"."""
    return "".join(
        letter for before, letter in zip(" " + word, word, strict=False) if before != letter
    )
