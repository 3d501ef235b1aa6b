"""Words of a request: vocabulary, tokens, spelling, and translation from four languages to English."""

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
"""Languages of requests besides English."""

Phrase = tuple[str, ...]
Words = frozenset[str]


@dataclass(frozen=True, slots=True)
class Language:
    """Language of requests: its phrases in English, removable endings, and a flag for compound
    nouns.
    """

    turned: Mapping[Phrase, Phrase]
    endings: tuple[str, ...]
    compounds: bool


@dataclass(frozen=True, slots=True)
class English:
    """Words of English requests, from `words/en.yaml`.

    Attributes:
        turned: replacements of phrases.
        classes: classes of each phrase, with a meaning if it has one.
        labels: tables from a word to its meaning, by name.
        sets: sets of words, by name.
        kinds: members of each class of objects.
        same: sets of synonyms.
        purposes: quantities by verb of an action.
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
        """Quantity of a comparative: mass for "heavier"."""
        return self.labels["compared"]


@cache
def english() -> English:
    """Return the words of English requests."""
    said = _read("en")
    # Classes without a meaning, then those whose meaning is the table's key.
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
    """Return the words of one of `LANGUAGES`."""
    said = _read(code)
    words = said["words"].items()
    turned = {phrase: tuple(word.split()) for word, of in words for phrase in _split_phrases(of)}
    return Language(turned, tuple(said["endings"].split()), bool(said.get("compounds", False)))


def longest(table: Iterable[Phrase]) -> int:
    """Number of words of the longest phrase."""
    return max(map(len, table), default=0)


def _words(text: str) -> Words:
    return frozenset(text.split())


def _by_word(labelled: Mapping[str, str]) -> dict[str, str]:
    """Map each word to its label."""
    return {word: label for label, words in labelled.items() for word in words.split()}


def _split_phrases(phrases: str) -> list[Phrase]:
    """Split phrases at commas; § stands for a literal comma."""
    found = [tuple(phrase.split()) for phrase in phrases.split(",")]
    return [tuple(word.replace("§", ",") for word in phrase) for phrase in found if phrase]


def _read(code: str) -> dict[str, Any]:
    file = files("palpate.planning.request").joinpath("words", f"{code}.yaml")
    return plain_yaml(file.read_text(encoding="utf-8"), f"words of '{code}'")


# Tokens, inflected forms, and spelling.


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
"""Expansions of contractions."""

_MASSES = r"kg|kilos?|kilogram(?:me)?s?|g|gram(?:me)?s?|mg|lbs?|pounds?|oz|ounces?"
_UNITS = r"[mck]?m|(?:milli|centi)?met(?:re|er)s?|inch(?:es)?|n|newtons?|n/mm?|%|percent|degrees?"
_AMOUNT = re.compile(
    rf"\b\d+(?:[.,]\d+)? *(?:{_MASSES}|{_UNITS})(?!\w)|"
    rf"\b(?:(?:half )?an?|one|two|three|five|ten) (?=\w{{4}})(?:{_MASSES}|{_UNITS})(?!\w)"
)
"""Number, or its word, with a unit."""


def tokens(request: str) -> list[str]:
    """Split a lower-case request into tokens.

    Tokens are words, `'s`, separating punctuation, and §amount for a number with its unit.
    Identifiers (`light_blue_box`, `bottle.mass`) are split into words.
    """
    # Expand contractions first, because they contain apostrophes.
    text = re.sub(r"\s+", " ", request)
    for pattern, apart in _APART:
        text = re.sub(pattern, apart, text)
    # Amounts become one token before punctuation is split.
    text = _AMOUNT.sub(" §amount ", text)
    # Split identifiers at underscores, hyphens and inner points.
    text = re.sub(r"[_\-]+", " ", text)
    text = re.sub(r"(\w\.\w+)(?=\s\w+\.\w)", r"\1 ,", text)  # "bottle.mass table.height"
    text = re.sub(r"\.(?=\S)|/", " ", text)
    return re.findall(r"§\w+|'s\b|\w+|[,;:.?!]", text)


def sentences(tokens: Sequence[str]) -> Iterator[list[str]]:
    """Yield each sentence; a question keeps its mark."""
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
    """Split a body name into words: `light_blue_box`, `LightBlueBox` and `light-blue box` are
    equal.
    """
    return tuple(re.findall(r"[^\W_]+", re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", name).lower()))


_FURTHER = re.compile(r"(?:body|base|top|link|obj|object|geom|mesh|part|main|root|\d)+")
"""Suffixes of model names without a meaning."""
_BEFORE = re.compile(r"(?=.*[aeiouy])\w{3,}")
"""Valid prefixes of compound nouns: `work` of `bench`, but not `sp` of `ring`."""


def is_further(word: str) -> bool:
    """True for a part of a name without a meaning: `main`, `1`, `a`."""
    return len(word) == 1 or bool(_FURTHER.fullmatch(word))


def is_within(word: str, name: str) -> bool:
    """True if a noun of at least three letters is the head of a compound name: `workbench`,
    `hammerbody`.
    """
    if len(word) < 3 or word == name:
        return False
    # The noun first with a meaningless suffix, or last in a compound.
    if name.startswith(word) and _FURTHER.fullmatch(name.removeprefix(word)):
        return True
    return name.endswith(word) and bool(_BEFORE.fullmatch(name.removesuffix(word)))


def singulars(word: str) -> tuple[str, ...]:
    """Return possible singulars of `word`, itself first."""
    forms = [word]
    # Plural endings: -ies, -ves, -es, -s.
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
    """Return possible base forms of `word`, itself first: "slide" for "sliding"."""
    found = [word]
    for ending in ("ing", "es", "ed", "s"):
        stem = word.removesuffix(ending)
        if stem == word or len(stem) < 2:
            continue
        # Also undo the final e, a doubled consonant, and y to i.
        found += [stem, stem + "e"]
        if stem[-1] == stem[-2]:
            found.append(stem[:-1])
        if stem.endswith("i"):
            found.append(stem[:-1] + "y")
    return tuple(found)


NEAR = 0.82
"""Ratio. Minimum similarity of letters in order. Misspellings keep the first letter, so "cable" is
not "table".
"""


def nearest_spelling(word: str, known: Collection[str]) -> str | None:
    """Return the known word that `word` misspells; None without one."""
    if not word.isalpha() or len(word) < 3:
        return None
    # Candidates have the same first letter and a similar length; swapped letters come first.
    like = [other for other in known if other[0] == word[0] and abs(len(other) - len(word)) <= 2]
    swapped = [other for other in like if len(word) > 3 and sorted(other) == sorted(word)]
    found = swapped or get_close_matches(word, like, 2, NEAR)
    return found[0] if found else None


# Translation of a request, word by word into English.


_BULLET = re.compile(r"(?:^|\n)\s*(?:[-*•–]|\d{1,2}\.)\s+")
"""Start of a list item."""

Names = frozenset[str]
"""Words of body names, which are never translated."""


def in_english(request: str, names: Names, code: str | None) -> str:
    """Translate a request from the language `code` to English, in lower case."""
    text = _plain(request)
    if code is not None:
        text = " ".join(_translate(_split_words(text), _glossary(code), names, language(code)))
        text = re.sub(r" , (?=(?:how|what|which|where|that|whether|if)\b)", " ", text)
    apart = re.findall(r"[\w'.,±]*[\w'±]|[^\w\s]", text)
    return " ".join(_translate(apart, english().turned, names))


def colours(code: str | None) -> frozenset[str]:
    """Return the colour words of a language and of English."""
    known = english().sets["colours"]
    turned = language(code).turned.items() if code else ()
    return known.union(phrase[0] for phrase, said in turned if not known.isdisjoint(said))


def spoken(request: str) -> str | None:
    """Return the language with the most known words; None for English."""
    words = _split_words(_plain(request))
    # English wins ties, because a language must exceed its count.
    best, most = None, sum(word in _english() for word in words)
    # Count the known words in each language.
    for code in LANGUAGES:
        known = {word for phrase in _glossary(code) for word in phrase}
        count = sum(word in known for word in words)
        if count > most:
            best, most = code, count
    return best


@cache
def _english() -> set[str]:
    """Return the common words of English requests."""
    said = english()
    synonyms = [phrase for quantity in catalogue().values() for phrase in quantity.words["en"]]
    known = {word for phrase in (*said.classes, *map(str.split, synonyms)) for word in phrase}
    return known.union(*(said.sets[name] for name in ("frame", "small", "adjectives")))


def _plain(request: str) -> str:
    return _BULLET.sub(" ; ", request).lower().replace("’", "'").replace("§", " ")


def _split_words(text: str) -> list[str]:
    """Split a text into words and punctuation; a word with an apostrophe becomes two."""
    return re.findall(r"\d+[.,]\d+|\w+|[,;:.?!]", text)


@cache
def _glossary(code: str) -> dict[Phrase, Phrase]:
    """Return the words of a language, including the quantities of the catalogue."""
    # The catalogue's phrases take precedence over those of the language.
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
    """Replace the longest phrases of the glossary; keep all other words."""
    at, most = 0, longest(glossary)
    while at < len(words):
        # A word may be the head of a compound name and stays then: "Tisch" for "schreibtisch".
        compound = spoken is not None and spoken.compounds and len(words[at]) > 3
        lengths = range(min(most, len(words) - at), 0, -1)
        if compound and any(is_within(words[at], name) for name in names):
            lengths = range(0)
        # Longest phrase first; names of bodies are never replaced.
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
    """Translate a word by its stem, or in parts as a compound noun."""
    if spoken is None or word in names:
        return (word,)
    if _bare(word) in names:
        return (_bare(word),)
    for stem in _stems(word, spoken):
        # A plural of a name in a language without compounds gets the English plural.
        if stem in names:
            return (stem if spoken.compounds else stem + "s",)
        if (stem,) in glossary:
            return glossary[stem,]
    # Split a compound noun where both parts are known.
    for at in range(3, len(word) - 3) if spoken.compounds else ():
        tail = glossary.get((word[at:],))
        for stem in (word[:at], *_stems(word[:at], spoken)) if tail else ():
            if stem in names or (len(stem) > 3 and (stem,) in glossary):
                return (*((stem,) if stem in names else glossary[stem,]), *(tail or ()))
    return (word,)


def _bare(word: str) -> str:
    """Remove the accents of a word, as in body names."""
    # Decompose accented letters and drop the combining marks.
    apart = unicodedata.normalize("NFD", word)
    return "".join(letter for letter in apart if not unicodedata.combining(letter))


def _stems(word: str, spoken: Language) -> Iterator[str]:
    for ending in spoken.endings:
        if word.endswith(ending) and len(word) > len(ending) + 2:
            yield word.removesuffix(ending)
