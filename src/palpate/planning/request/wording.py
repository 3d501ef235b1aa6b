"""The words of `words/*.yaml`, as what reads requests looks them up."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from palpate.files.plain_yaml import plain_yaml
from palpate.quantities.purposes import quantities_by_verb

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
        for phrase in _listed(phrases):
            classes[phrase].append((kind, ()))
    for kind, table in (("REL", "relations"), ("SEL", "selecting"), ("NUM", "numbers")):
        for value, phrases in said[table].items():
            for phrase in _listed(phrases):
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
    turned = {phrase: tuple(word.split()) for word, of in words for phrase in _listed(of)}
    return Language(turned, tuple(said["endings"].split()), bool(said.get("compounds", False)))


def longest(table: Iterable[Phrase]) -> int:
    """Words of the longest phrase."""
    return max(map(len, table), default=0)


def _words(text: str) -> Words:
    return frozenset(text.split())


def _by_word(labelled: Mapping[str, str]) -> dict[str, str]:
    """Each word to the label that it stands under."""
    return {word: label for label, words in labelled.items() for word in words.split()}


def _listed(phrases: str) -> list[Phrase]:
    """Phrases between commas; § is a comma itself."""
    found = [tuple(phrase.split()) for phrase in phrases.split(",")]
    return [tuple(word.replace("§", ",") for word in phrase) for phrase in found if phrase]


def _read(code: str) -> dict[str, Any]:
    file = files("palpate.planning.request").joinpath("words", f"{code}.yaml")
    return plain_yaml(file.read_text(encoding="utf-8"), f"words of '{code}'")
