"""A request in any of five languages, word by word in English.

The grammar of what is asked is so plain that the words may stay where they are: "Wo liegt der
Schwerpunkt des Hammers?" becomes "where is the centre of mass of the hammer?".
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator, Mapping, Sequence

from palpate.planning.request.lexicon import COLOURS
from palpate.planning.request.tokens import is_within, nearest_spelling
from palpate.planning.request.wording import (
    LANGUAGES,
    Language,
    Phrase,
    english,
    language,
    longest,
    tells,
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
        text = " ".join(_turned(_words(text), _glossary(code), names, code))
        text = re.sub(r" , (?=(?:how|what|which|where|that|whether|if)\b)", " ", text)
    apart = re.findall(r"[\w'.,±]*[\w'±]|[^\w\s]", text)
    return " ".join(_turned(apart, english().turned, names))


def colours(code: str | None) -> frozenset[str]:
    """The words of colours in a language, and in English."""
    if code is None:
        return COLOURS
    turned = language(code).turned.items()
    return COLOURS.union(phrase[0] for phrase, said in turned if not COLOURS.isdisjoint(said))


def spoken(request: str) -> str | None:
    """Language of the request, by its frequent small words; None for English.

    Where there are English words, only languages that something tells are looked into.
    """
    words = _words(_plain(request))
    of_english = 2 * sum(word in tells()["en"] for word in words)
    best, most = None, of_english
    for code in LANGUAGES:
        told = sum(word in tells()[code] for word in words)
        if told or not of_english:
            count = told + sum((word,) in language(code).turned for word in words)
            if count > most:
                best, most = code, count
    return best


def _plain(request: str) -> str:
    return _BULLET.sub(" ; ", request).lower().replace("’", "'").replace("§", " ")


def _words(text: str) -> list[str]:
    """The words of a text, those with an apostrophe in two, and what separates sentences."""
    return re.findall(r"\d+[.,]\d+|\w+|[,;:.?!]", text)


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
    code: str | None = None,
) -> Iterator[str]:
    """The longest phrases of the glossary as what it turns them into, all else as it is."""
    at, most = 0, longest(glossary)
    spoken = None if code is None else language(code)
    while at < len(words):
        if code is not None and _is_noun_of(words[at], names, code):
            yield words[at]
            at += 1
            continue
        for length in range(min(most, len(words) - at), 0, -1):
            phrase = tuple(words[at : at + length])
            if phrase in glossary and names.isdisjoint([*phrase, _bare(words[at])]):
                yield from glossary[phrase]
                at += length
                break
        else:
            yield from _inflected(words[at], glossary, names, spoken)
            at += 1


def _is_noun_of(word: str, names: Names, code: str) -> bool:
    """Test that the noun of a compound is among the names: "Tisch" for a "schreibtisch", but not
    "der" for "powder"."""
    if not language(code).compounds or word in names or word in tells()[code]:
        return False
    return any(is_within(word, name) for name in names)


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
    if spoken.compounds:
        for at in range(3, len(word) - 3):
            head, tail = _inflected_part(word[:at], glossary, names, spoken), (word[at:],)
            if head and tail in glossary:
                return (*head, *glossary[tail])
    slip = nearest_spelling(word, _often(glossary))
    return glossary[slip,] if slip else (word,)


def _often(glossary: Mapping[Phrase, Phrase]) -> list[str]:
    """The words of questions, which are looked for where somebody slipped."""
    found: list[str] = []
    for phrase, said in glossary.items():
        if len(phrase) == 1 and len(phrase[0]) > 4 and english().often.issuperset(said):
            found.append(phrase[0])
    return found


def _bare(word: str) -> str:
    """A word without accents, as names of bodies are written."""
    apart = unicodedata.normalize("NFD", word)
    return "".join(letter for letter in apart if not unicodedata.combining(letter))


def _inflected_part(
    word: str, glossary: Mapping[Phrase, Phrase], names: Names, spoken: Language
) -> Phrase:
    for stem in (word, *_stems(word, spoken)):
        if stem in names:
            return (stem,)
        if (stem,) in glossary and len(stem) > 3:
            return glossary[stem,]
    return ()


def _stems(word: str, spoken: Language) -> Iterator[str]:
    for ending in spoken.endings:
        if word.endswith(ending) and len(word) > len(ending) + 2:
            yield word.removesuffix(ending)
    for plural, singular in spoken.plurals.items():
        if word.endswith(plural) and len(word) > len(plural) + 2:
            yield word.removesuffix(plural) + singular
