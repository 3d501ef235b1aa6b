"""Words of a request: vocabulary, tokens, spelling, and five languages."""

from __future__ import annotations

import re
import unicodedata
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from importlib.resources import files
from typing import Any

from palpate.common.files import plain_yaml
from palpate.estimation.quantities.catalogue import catalogue, quantities_by_verb

LANGUAGES = ("de", "es", "fr", "it")
"""Languages of requests, without English."""

Phrase = tuple[str, ...]
Words = frozenset[str]


@dataclass(frozen=True, slots=True)
class Language:
    """A language that requests may be written in: its phrases in English, the endings that inflected
    words may lose, and whether it writes several nouns in one word."""

    turned: Mapping[Phrase, Phrase]
    endings: tuple[str, ...]
    compounds: bool


@dataclass(frozen=True, slots=True)
class English:
    """Words of English requests, from `words/en.yaml`.

    Attributes:
        classes: the classes of a phrase, each with its meaning if it has one.
        labels: tables from a word to what it stands for, by name.
        sets: sets of words, by name.
    """

    turned: Mapping[Phrase, Phrase]
    classes: Mapping[Phrase, list[tuple[str, tuple[str, ...]]]]
    labels: Mapping[str, Mapping[str, str]]
    sets: Mapping[str, Words]
    kinds: Mapping[str, Words]
    same: tuple[Words, ...]
    purposes: Mapping[str, tuple[str, ...]]

    @property
    def compared(self) -> Mapping[str, str]:
        """Quantity that a comparing word is about: mass for "heavier"."""
        return self.labels["compared"]


@cache
def english() -> English:
    """The words of English requests."""
    said = _read("en")
    classes: dict[Phrase, list[tuple[str, tuple[str, ...]]]] = defaultdict(list)
    for kind, phrases in (*said["classes"].items(), ("FILL", said["frames"])):
        for phrase in _split_phrases(phrases):
            classes[phrase].append((kind, ()))
    for kind, table in (("REL", "relations"), ("SEL", "selecting"), ("NUM", "numbers")):
        for value, phrases in said[table].items():
            for phrase in _split_phrases(phrases):
                classes[phrase].append((kind, (value,)))
    labels = ("compared", "asked", "unfelt", "irregular", "numbers")
    return English(
        turned={tuple(phrase.split()): tuple(by.split()) for phrase, by in said["turned"].items()},
        classes=classes,
        labels={name: _by_word(said[name]) for name in labels},
        sets={name: _words(words) for name, words in said["sets"].items()},
        kinds={kind: _words(members) for kind, members in said["kinds"].items()},
        same=tuple(_words(line) for line in said["same"].split(",")),
        purposes=quantities_by_verb(),
    )


@cache
def language(code: str) -> Language:
    """Words of one of `LANGUAGES`."""
    said = _read(code)
    words = said["words"].items()
    turned = {phrase: tuple(word.split()) for word, of in words for phrase in _split_phrases(of)}
    return Language(turned, tuple(said["endings"].split()), bool(said.get("compounds", False)))


def longest(table: Iterable[Phrase]) -> int:
    """Words of the longest phrase."""
    return max(map(len, table), default=0)


def _words(text: str) -> Words:
    return frozenset(text.split())


def _by_word(labelled: Mapping[str, str]) -> dict[str, str]:
    """Each word to the label that it stands under."""
    return {word: label for label, words in labelled.items() for word in words.split()}


def _split_phrases(phrases: str) -> list[Phrase]:
    """Phrases between commas; § is a comma itself."""
    found = [tuple(phrase.split()) for phrase in phrases.split(",")]
    return [tuple(word.replace("§", ",") for word in phrase) for phrase in found if phrase]


def _read(code: str) -> dict[str, Any]:
    file = files("palpate.planning.request").joinpath("words", f"{code}.yaml")
    return plain_yaml(file.read_text(encoding="utf-8"), f"words of '{code}'")


# Words of a request: tokens, inflected forms, spelling.


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


# A request in any of five languages, word by word in English.


_BULLET = re.compile(r"(?:^|\n)\s*(?:[-*•–]|\d{1,2}\.)\s+")
"""Start of a list item."""

Names = frozenset[str]
"""Words of the names of bodies: nobody turns them into others."""


def in_english(request: str, names: Names, code: str | None) -> str:
    """The request, lower case, its words turned from the language `code` into English ones."""
    text = _plain(request)
    if code is not None:
        text = " ".join(_translate(_split_words(text), _glossary(code), names, language(code)))
        text = re.sub(r" , (?=(?:how|what|which|where|that|whether|if)\b)", " ", text)
    apart = re.findall(r"[\w'.,±]*[\w'±]|[^\w\s]", text)
    return " ".join(_translate(apart, english().turned, names))


def colours(code: str | None) -> frozenset[str]:
    """The words of colours in a language, and in English."""
    known = english().sets["colours"]
    turned = language(code).turned.items() if code else ()
    return known.union(phrase[0] for phrase, said in turned if not known.isdisjoint(said))


def spoken(request: str) -> str | None:
    """Language of the request, by the number of its known words; None for English."""
    words = _split_words(_plain(request))
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


def _split_words(text: str) -> list[str]:
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


def _translate(
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
            yield from _base_form(words[at], glossary, names, spoken) if lengths else (words[at],)
            at += 1


def _base_form(
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
