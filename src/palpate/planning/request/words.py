"""Words of requests in five languages: tokens, phrases with their classes, and concepts of nouns."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any

from palpate.estimation.quantities.catalogue import catalogue

LANGUAGES = ("en", "de", "fr", "it", "es")
"""Languages of requests, in the order of the columns of the word lists."""
EXACT = 3
"""Maximum number of letters of a word whose accents must agree: the French "où" and "ou"."""
NEAR = 0.82
"""Minimum similarity of a misspelt word to the known one. The first letters must agree."""

SHORT = 6
"""Maximum number of letters of a word that is not read as another one of its length."""
CACHED = 1 << 14
"""Words whose forms are remembered."""

_OTHERWISE = frozenset({"place", "where", "level", "weigh", "lean"})
"""Names of quantities with other frequent uses, which `words/classes.txt` covers."""

_SPELT_OUT = ("W", "A", "C", "N", "UNFELT", "EXCEPT", "WHICH")
"""Classes whose words may be misspelt."""

Classes = Mapping[str, str]
"""Classes of a phrase, each with its value; without a value, it is empty."""


@dataclass(frozen=True)
class Language:
    """Word lists of one language.

    Attributes:
        is_english: its plurals are English.
        entries: phrases with class and value, by the first two letters; `*` stands for any ending.
        nouns: concepts of each noun or adjective, the usual concept first.
        words: all complete words, for the correction of spelling.
    """

    is_english: bool
    entries: dict[str, list[Any]] = field(default_factory=dict[str, list[Any]])
    nouns: dict[str, list[str]] = field(default_factory=dict[str, list[str]])
    words: set[str] = field(default_factory=set[str])

    def add(self, phrase: str, name: str, value: str) -> None:
        """Add a phrase of a class."""
        words = tuple(re.split(r"[ '-]+", phrase))
        key = without_accents(words[0])[:2].rstrip("*")
        self.entries.setdefault(key, []).append((words, name, value))
        if len(words) == 1 and name in _SPELT_OUT and len(phrase) > EXACT and "*" not in phrase:
            self.words.add(phrase)

    def match(self, words: Sequence[str], at: int) -> tuple[int, Classes]:
        """Return the number of words of the longest phrase at a position, and its classes."""
        most, classes = 0, dict[str, str]()
        key = without_accents(words[at])
        for forms, name, value in (*self.entries.get(key[:2], ()), *self.entries.get(key[:1], ())):
            said = words[at : at + len(forms)]
            if len(said) >= max(len(forms), most) and all(map(_agrees, said, forms)):
                if len(said) > most:
                    most, classes = len(said), dict[str, str]()
                classes.setdefault(name, value)
        return most, classes

    def concepts(self, word: str) -> tuple[str, ...]:
        """Return the concepts of a noun or adjective, the usual one first."""
        for said in dict.fromkeys((word, without_accents(word) if len(word) > EXACT else word)):
            for form in singulars(said, self.is_english):
                if form in self.nouns:
                    return tuple(self.nouns[form])
            for length in range(len(said), 1, -1):
                if f"{said[:length]}*" in self.nouns:
                    return tuple(self.nouns[f"{said[:length]}*"])
        return ()

    def is_noun(self, word: str) -> bool:
        """True for a noun of the list, not for an adjective."""
        return any(
            not one.startswith("+") for form in singulars(word) for one in self.nouns.get(form, ())
        )

    def parts(self, word: str) -> tuple[str, str] | None:
        """Split a compound noun whose two parts are known: "Tischhöhe"; None for other words."""
        for at in range(2, len(word) - 2):
            tail, head = word[at:], word[:at]
            known = self.match([tail], 0)[0] or self.concepts(tail)
            for stem in (head, *singulars(head), f"{head}e") if known else ():
                if self.concepts(stem):
                    return stem, tail
        return None


@lru_cache(CACHED)
def _agrees(word: str, form: str) -> bool:
    """True if a word is the form of an entry; longer words may lack their accents."""
    if form.endswith("*"):
        bare = without_accents(form[:-1]) if len(form) > EXACT + 1 else form[:-1]
        return word.startswith((form[:-1], bare))
    return word == form or (len(word) > EXACT and word == without_accents(form))


def languages() -> Mapping[str, Language]:
    """Return the word lists of all languages, with the names of all installed quantities."""
    return _languages(tuple(catalogue()))


@cache
def _languages(ids: tuple[str, ...]) -> Mapping[str, Language]:
    """Return the word lists, with the names of these quantities."""
    found = {code: Language(code == "en") for code in LANGUAGES}
    for head, columns in _rows("classes"):
        name, _, value = head.partition(" ")
        for code, listed in columns:
            for phrase in filter(None, map(str.strip, listed.split(","))):
                found[code].add(phrase, name, value)
    for id in ids:
        for code, phrases in catalogue()[id].words.items():
            for phrase in set(phrases) - _OTHERWISE:
                found[code].add(phrase, "N", id)
    for head, columns in _rows("nouns"):
        for code, listed in columns:
            for place, word in enumerate(listed.split()):
                for form in {word, without_accents(word) if len(word) > EXACT else word}:
                    concepts = found[code].nouns.setdefault(form, [])
                    concepts.insert(0 if place == 0 else len(concepts), head)
                if "*" not in word:
                    found[code].words.add(word)
    return found


@cache
def kinds() -> Mapping[str, frozenset[str]]:
    """Return the English members of each class of objects."""
    rows = re.findall(r"^(=\w+):([\w ]+)", _text("nouns"), re.MULTILINE)
    return {head: frozenset(members.split()) for head, members in rows}


def _text(name: str) -> str:
    return files("palpate.planning.request").joinpath("words", f"{name}.txt").read_text("utf-8")


def _rows(name: str) -> Iterator[tuple[str, list[tuple[str, str]]]]:
    """Yield the head of each row of a word list, and its columns by language.

    The head of nouns is the first English word, with a mark: `+red`, `=container`.
    """
    for line in filter(None, _text(name).splitlines()):
        first, *others = line.split("|")
        head, colon, listed = first.rpartition(":")
        if not colon:
            head, listed = first.split()[0], first.lstrip("+")
        elif head.startswith("="):
            listed = head[1:]
        if not line.startswith("#"):
            yield head, list(zip(LANGUAGES, (listed, *others), strict=True))


# Tokens, inflected forms, and spelling.

_EXPANSIONS = (
    (r"\bcan'?t\b|\bcannot\b", "can not"),
    (r"\bwon't\b", "will not"),
    (r"n't\b", " not"),
    (r"'m\b", " am"),
    (r"'re\b", " are"),
    (r"'ve\b", " have"),
    (r"'ll\b", " will"),
    (r"'d\b", " would"),
    (r"\b(table|bench|desk|counter)[ -]?top\b", r"\1"),
    (
        r"\b(what|who|where|there|here|how|it|that|whatever|everything|all|which)'s\b|\b(what)s\b",
        r"\1\2 is",
    ),
    (r"\blet's\b", "let us"),
    (r"[&+](?!/|-)", " and "),
    (r"[()]", " , "),
    (r"(?<!\S)\(?[\da-h] ?\) |(?:^|\n)\s*(?:[-*•–]|\d{1,2}\.)\s+", " ; "),
)
"""Expansions of English contractions, and marks of list items."""
_UNITS = (
    r"kg|kilogr?am(?:me|m|mi|mo|os|o)?s?|kilos?|chil[io]|chilogramm[io]|g|gr|gram(?:me|m|mi|mo|os|o)?s?|mg|"
    r"lbs?|pounds?|oz|ounces?|[mckµu]?m|(?:milli|centi)?met(?:re|er|ri|ro|ros)s?|n/mm?|n|%|percent|degrees?|°"
)
_AMOUNT = re.compile(
    rf"(?P<width>±|\+/-|\+-)? *\b(?P<number>\d+(?:[.,]\d+)?|half an?|(?:ein(?:e[mns]?)? )?halbes|un demi|"
    rf"mezzo|medio|(?:an?|one|two|three|four|five|ten|ein|un|une)(?= \w{{4}})) *-?(?P<unit>{_UNITS})(?!\w)"
)
"""Number, or its word, with a unit."""
_NUMBERS = {"two": "2", "three": "3", "four": "4", "five": "5", "ten": "10"}
_SPELT = "kilo:kg chil:kg gr:g millimet:mm centimet:cm met:m µm:um n/mm:kN/m n/m:N/m"
"""Units by the beginnings of their words."""


def amount(text: str) -> str:
    """Return an amount of a request as a number and a unit: "0.5 kg" for "half a kilo"."""
    found = _AMOUNT.search(text)
    assert found is not None
    number, unit = found["number"], found["unit"]
    if not number[0].isdigit():
        half = re.search(r"half|halb|demi|mezzo|medio", number)
        number = "0.5" if half else _NUMBERS.get(number, "1")
    units = (pair.split(":") for pair in _SPELT.split())
    spelt = next((to for start, to in units if unit.startswith(start)), unit)
    return f"{number.replace(',', '.')} {spelt}"


def is_weight(text: str) -> bool:
    """True for an amount in a unit of mass."""
    return bool(text) and amount(text.replace("~", " ")).endswith(("g", "lb", "lbs", "oz"))


def tokens(request: str) -> list[str]:
    """Split a request into lower-case words, `'s`, punctuation, and amounts as `§400 g`.

    Identifiers (`light_blue_box`, `bottle.mass`) are split into words.
    """
    text = request.lower().replace("’", "'").replace("§", " ")
    for pattern, by in _EXPANSIONS:
        text = re.sub(pattern, by, text)
    # An amount becomes one token, before points and commas separate.
    text = _AMOUNT.sub(lambda found: f" §{found[0].strip().replace(' ', '~')} ", text)
    text = re.sub(r"(\w\.\w+)(?=\s\w+\.\w)", r"\1 ,", text)  # "bottle.mass table.height"
    joints = r"(?<=[^\W\d_])\.(?=[^\W\d_])|(?<=[^\W_])[_\-/](?=[^\W_])"
    text = re.sub(rf"(§\S+)|{joints}", lambda found: found[1] or " ", text)
    found = re.findall(r"§\S+|'s\b|[^\W_]+|[,;:.?!–—-]", text)
    return ["," if token in "–—-" else token for token in found]


@lru_cache(CACHED)
def without_accents(word: str) -> str:
    """Remove the accents of a word."""
    apart = unicodedata.normalize("NFD", word.replace("ß", "ss").replace("œ", "oe"))
    return "".join(letter for letter in apart if not unicodedata.combining(letter))


_SINGULARS = "ies:y ves:f ves:fe es: s: x: en: n: er: em: e: ces:z e:a i:o i:e che:ca chi:co ghe:ga"
"""Endings of plurals, with those of their singulars, the English ones first."""


@lru_cache(CACHED)
def singulars(word: str, english: bool = False) -> tuple[str, ...]:
    """Return possible singulars of `word` in any language, or in English, itself first."""
    forms = [word]
    for ending, by in (pair.split(":") for pair in _SINGULARS.split()[: 5 if english else None]):
        stem = word.removesuffix(ending)
        if stem != word and len(stem) > 1 and not (ending == "s" and stem.endswith("s")):
            forms.append(stem + by)
    return tuple(dict.fromkeys(forms))


def nearest_spelling(word: str, known: Collection[str]) -> str | None:
    """Return the known word that `word` misspells; None without one."""
    if not word.isalpha() or len(word) < EXACT:
        return None
    # Candidates have the same first letter and a similar length; swapped letters come first.
    like = [other for other in known if other[0] == word[0] and abs(len(other) - len(word)) <= 2]
    if len(word) == EXACT:
        found = sorted(other for other in like if other[:-1] == word)
    else:
        found = sorted(other for other in like if sorted(other) == sorted(word))
        # Another letter in a short word is rather another word: "former", not "firmer".
        like = [other for other in like if len(other) != len(word) or len(word) > SHORT]
        found = found or get_close_matches(word, sorted(like), 2, NEAR)
    return found[0] if found else None


def spoken(words: Sequence[str], names: Collection[str]) -> str:
    """Return the language that knows most of the words; names of bodies do not count."""
    counts: dict[str, int] = dict.fromkeys(LANGUAGES, 0)
    for at, word in enumerate(words):
        if word.isalpha() and word not in names:
            for code, language in languages().items():
                known = language.match(words, at)[0] or language.concepts(word)
                counts[code] += bool(known or (code == "de" and language.parts(word)))
    return max(LANGUAGES, key=lambda code: counts[code])
