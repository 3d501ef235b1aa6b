"""Words of a request: tokens, inflected forms, spelling."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence
from difflib import get_close_matches

_APART = (
    (r"\bcan'?t\b|\bcannot\b", "can not"),
    (r"\bwon't\b", "will not"),
    (r"n't\b", " not"),
    (r"'m\b", " am"),
    (r"'re\b", " are"),
    (r"'ve\b", " have"),
    (r"'ll\b", " will"),
    (r"'d\b", " would"),
    (r"\blet's\b", "let us"),
    (r"\b(what|who|where|there|here|how|it|that)'s\b", r"\1 is"),
    (r"[&+]", " and "),
    (r"(?<!\S)\(?[\da-h] ?\) ", " ; "),
)
"""Contractions, as two words."""

_MASSES = r"kg|kilos?|kilogram(?:me)?s?|g|gram(?:me)?s?|mg|lbs?|pounds?|oz|ounces?"
_UNITS = r"[mck]?m|(?:milli|centi)?met(?:re|er)s?|inch(?:es)?|n|newtons?|n/mm?|%|percent|degrees?"
_AMOUNT = re.compile(
    rf"\b\d+(?:[.,]\d+)? *(?:{_MASSES}|{_UNITS})(?!\w)|"
    rf"\b(?:(?:half )?an?|one|two|three|five|ten) (?=\w{{4}})(?:{_MASSES}|{_UNITS})(?!\w)"
)
"""A figure, or the word of one, with its unit."""


def tokens(request: str) -> list[str]:
    """Words, `'s`, punctuation that separates, and §amount for a figure with its unit, of a request
    in lower case.

    Names written as identifiers (`light_blue_box`, `bottle.mass`) come apart into their words.
    """
    text = re.sub(r"\s+", " ", request)
    for pattern, apart in _APART:
        text = re.sub(pattern, apart, text)
    text = _AMOUNT.sub(" §amount ", text)
    text = re.sub(r"[_\-]+", " ", text)
    text = re.sub(r"(\w\.\w+)(?=\s\w+\.\w)", r"\1 ,", text)  # "bottle.mass table.height"
    text = re.sub(r"\.(?=\S)|/", " ", text)
    return re.findall(r"§\w+|'s\b|\w+|[,;:.?!]", text)


def sentences(tokens: Sequence[str]) -> Iterator[list[str]]:
    """Each sentence, a question with its mark."""
    sentence: list[str] = []
    for token in [*tokens, "."]:
        if token == "?" and sentence:
            sentence.append(token)
        if token not in ".;?!":
            sentence.append(token)
        elif sentence:
            yield sentence
            sentence = []


def name_words(name: str) -> tuple[str, ...]:
    """The words of a body's name: `light_blue_box`, `LightBlueBox`, `light-blue box` are the same
    three."""
    return tuple(re.findall(r"[^\W_]+", re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", name).lower()))


_FURTHER = re.compile(r"(?:body|base|top|link|obj|object|geom|mesh|part|main|root|\d)+")
"""Words behind a noun in names of models, without a meaning of their own."""
_BEFORE = re.compile(r"(?=.*[aeiouy])\w{3,}")
"""Prefixes of compound nouns: `work` of `bench`, but not `sp` of `ring`."""


def is_further(word: str) -> bool:
    """Test for a part of a name without a meaning: `main`, `1`, `a`."""
    return len(word) == 1 or bool(_FURTHER.fullmatch(word))


def is_within(word: str, name: str) -> bool:
    """Test that a noun of at least three letters is the head of a compound name: `workbench`,
    `hammerbody`."""
    if len(word) < 3 or word == name:
        return False
    if name.startswith(word) and _FURTHER.fullmatch(name.removeprefix(word)):
        return True
    return name.endswith(word) and bool(_BEFORE.fullmatch(name.removesuffix(word)))


def singulars(word: str) -> tuple[str, ...]:
    """Words of which `word` may be the plural or the gerund, itself first."""
    forms = [word]
    if word.endswith("ies"):
        forms.append(word[:-3] + "y")
    if word.endswith("ves"):
        forms += [word[:-3] + "f", word[:-3] + "fe"]
    if word.endswith("es"):
        forms.append(word[:-2])
    if word.endswith("s") and not word.endswith("ss"):
        forms.append(word[:-1])
    return tuple(forms)


def lemmas(word: str) -> tuple[str, ...]:
    """Words of which `word` may be a form, itself first: "slide" for "sliding"."""
    found = [word]
    for ending in ("ing", "es", "ed", "s"):
        stem = word.removesuffix(ending)
        if stem == word or len(stem) < 2:
            continue
        found += [stem, stem + "e"]
        if stem[-1] == stem[-2]:
            found.append(stem[:-1])
        if stem.endswith("i"):
            found.append(stem[:-1] + "y")
    return tuple(found)


NEAR = 0.82
"""Share of the letters that must be the same and in order. Nobody's slip changes the first letter;
a cable is no table."""


def nearest_spelling(word: str, known: Collection[str]) -> str | None:
    """The one of `known` that `word` is a slip of; None if there is none."""
    if not word.isalpha() or len(word) < 3:
        return None
    like = [other for other in known if other[0] == word[0] and abs(len(other) - len(word)) <= 2]
    swapped = [other for other in like if len(word) > 3 and sorted(other) == sorted(word)]
    found = swapped or get_close_matches(word, like, 2, NEAR)
    return found[0] if found else None
