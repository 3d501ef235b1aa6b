"""Words of a request: tokens, inflected forms, spelling."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from difflib import SequenceMatcher

from palpate.planning.request.lexicon import AMOUNTS

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


def tokens(request: str) -> list[str]:
    """Words, `'s`, punctuation that separates, and §amount for a figure with its unit, of a request
    in lower case.

    Names written as identifiers (`light_blue_box`, `bottle.mass`) come apart into their words.
    """
    text = re.sub(r"\s+", " ", request)
    for pattern, apart in _APART:
        text = re.sub(pattern, apart, text)
    for pattern, amount in AMOUNTS:
        text = re.sub(pattern, f" {amount} ", text)
    text = re.sub(r"[_\-]+", " ", text)
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


def forms(word: str) -> tuple[tuple[str, str], ...]:
    """Verbs of which `word` may be a form, with the form: "sliding" is "slide" and `_ING`."""
    found = [(word, "")]
    for ending, tag in (("ing", "_ING"), ("es", "_S"), ("ed", "_ED"), ("s", "_S")):
        stem = word.removesuffix(ending)
        if stem == word or len(stem) < 2:
            continue
        found += [(stem, tag), (stem + "e", tag)]
        if stem[-1] == stem[-2]:
            found.append((stem[:-1], tag))
        if stem.endswith("i"):
            found.append((stem[:-1] + "y", tag))
    return tuple(found)


SHORTEST = 4
"""Letters: a shorter word is near too many others."""
NEAR = 0.82
"""Share of the letters that must be the same and in order. Nobody's slip changes the first letter;
a cable is no table."""


def nearest_spelling(word: str, known: Collection[str]) -> str | None:
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
    """Known words at the least distance, if it is small."""
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
