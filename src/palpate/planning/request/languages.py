"""A request in any of five languages, word by word in English.

The grammar of what is asked is so plain that the words may stay where they are: "Wo liegt der
Schwerpunkt des Hammers?" becomes "where is the centre of mass of the hammer?".
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from functools import cache

from palpate.planning.request.tokens import is_within
from palpate.planning.request.wording import (
    LANGUAGES,
    Language,
    Phrase,
    english,
    language,
    longest,
)
from palpate.quantities.catalogue import catalogue

_BULLET = re.compile(r"(?:^|\n)\s*(?:[-*•–]|\d{1,2}\.)\s+")
"""Start of a list item."""

Names = frozenset[str]
"""Words of the names of bodies: nobody turns them into others."""


def in_english(request: str, names: Names, code: str | None) -> str:
    """The request, lower case, its words turned from the language `code` into English ones."""
    text = _plain(request)
    if code is not None:
        text = " ".join(_turned(_words(text), _glossary(code), names, language(code)))
        text = re.sub(r" , (?=(?:how|what|which|where|that|whether|if)\b)", " ", text)
    apart = re.findall(r"[\w'.,±]*[\w'±]|[^\w\s]", text)
    return " ".join(_turned(apart, english().turned, names))


def colours(code: str | None) -> frozenset[str]:
    """The words of colours in a language, and in English."""
    known = english().sets["colours"]
    turned = language(code).turned.items() if code else ()
    return known.union(phrase[0] for phrase, said in turned if not known.isdisjoint(said))


def spoken(request: str) -> str | None:
    """Language of the request, by the number of its known words; None for English."""
    words = _words(_plain(request))
    best, most = None, sum(word in _english() for word in words)
    for code in LANGUAGES:
        known = {word for phrase in _glossary(code) for word in phrase}
        count = sum(word in known for word in words)
        if count > most:
            best, most = code, count
    return best


@cache
def _english() -> set[str]:
    """Common words of English requests."""
    said = english()
    synonyms = [phrase for quantity in catalogue().values() for phrase in quantity.words["en"]]
    known = {word for phrase in (*said.classes, *map(str.split, synonyms)) for word in phrase}
    return known.union(*(said.sets[name] for name in ("frame", "small", "adjectives")))


def _plain(request: str) -> str:
    return _BULLET.sub(" ; ", request).lower().replace("’", "'").replace("§", " ")


def _words(text: str) -> list[str]:
    """The words of a text, those with an apostrophe in two, and what separates sentences."""
    return re.findall(r"\d+[.,]\d+|\w+|[,;:.?!]", text)


@cache
def _glossary(code: str) -> dict[Phrase, Phrase]:
    """A language's words, those of quantities as the catalogue has them."""
    glossary = dict(language(code).turned)
    for quantity in catalogue().values():
        for phrase in quantity.words.get(code, ()):
            glossary[tuple(phrase.split())] = tuple(quantity.words["en"][0].split())
    return glossary


def _turned(
    words: Sequence[str],
    glossary: Mapping[Phrase, Phrase],
    names: Names,
    spoken: Language | None = None,
) -> Iterator[str]:
    """The longest phrases of the glossary as what it turns them into, all else as it is."""
    at, most = 0, longest(glossary)
    while at < len(words):
        # The noun of a compound among the names: "Tisch" for a "schreibtisch".
        compound = spoken is not None and spoken.compounds and len(words[at]) > 3
        lengths = range(min(most, len(words) - at), 0, -1)
        if compound and any(is_within(words[at], name) for name in names):
            lengths = range(0)
        for length in lengths:
            phrase = tuple(words[at : at + length])
            if phrase in glossary and names.isdisjoint([*phrase, _bare(words[at])]):
                yield from glossary[phrase]
                at += length
                break
        else:
            yield from _inflected(words[at], glossary, names, spoken) if lengths else (words[at],)
            at += 1


def _inflected(
    word: str, glossary: Mapping[Phrase, Phrase], names: Names, spoken: Language | None
) -> Phrase:
    """A word that the glossary, or a name, has without its ending or in parts."""
    if spoken is None or word in names:
        return (word,)
    if _bare(word) in names:
        return (_bare(word),)
    for stem in _stems(word, spoken):
        if stem in names:
            return (stem if spoken.compounds else stem + "s",)
        if (stem,) in glossary:
            return glossary[stem,]
    for at in range(3, len(word) - 3) if spoken.compounds else ():
        tail = glossary.get((word[at:],))
        for stem in (word[:at], *_stems(word[:at], spoken)) if tail else ():
            if stem in names or (len(stem) > 3 and (stem,) in glossary):
                return (*((stem,) if stem in names else glossary[stem,]), *(tail or ()))
    return (word,)


def _bare(word: str) -> str:
    """A word without accents, as names of bodies are written."""
    apart = unicodedata.normalize("NFD", word)
    return "".join(letter for letter in apart if not unicodedata.combining(letter))


def _stems(word: str, spoken: Language) -> Iterator[str]:
    for ending in spoken.endings:
        if word.endswith(ending) and len(word) > len(ending) + 2:
            yield word.removesuffix(ending)
