"""The words of `words/*.yaml`, as what reads requests looks them up."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from palpate.files.plain_yaml import plain_yaml
from palpate.planning.request.lexicon import by_word, word_set

LANGUAGES = ("de", "es", "fr", "it")
"""Besides English."""

Phrase = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Language:
    """A language that requests may be written in.

    Attributes:
        turned: its phrases in English.
        endings: of inflected words, which may be left away.
        compounds: whether it writes several nouns in one word.
    """

    turned: Mapping[Phrase, Phrase]
    endings: tuple[str, ...]
    compounds: bool


@dataclass(frozen=True, slots=True)
class English:
    """What English words are; the keys of `words/en.yaml` tell what each is for."""

    turned: Mapping[Phrase, Phrase]
    compared: Mapping[str, str]
    superlatives: frozenset[str]
    degrees: frozenset[str]
    than: frozenset[str]
    relations: Mapping[Phrase, str]
    tying: frozenset[str]
    selecting: Mapping[str, str]
    kinds: Mapping[str, frozenset[str]]
    collective: frozenset[str]
    same: tuple[frozenset[str], ...]
    deeds: frozenset[str]
    handling: frozenset[str]
    purposes: Mapping[str, tuple[str, ...]]
    states: frozenset[str]
    harmless: frozenset[str]
    aside: frozenset[str]
    nouns: frozenset[str]
    wishes: frozenset[str]


@cache
def english() -> English:
    """The words of English requests."""
    said = _read("en")
    relations: dict[Phrase, str] = {}
    for relation, phrases in said["relations"].items():
        for phrase in phrases.split(","):
            relations[tuple(phrase.split())] = relation
    purposes: dict[str, tuple[str, ...]] = {}
    for quantities, verbs in said["purposes"].items():
        purposes |= dict.fromkeys(verbs.split(), tuple(quantities.split()))
    sets = ("collective", "superlatives", "degrees", "than", "tying", "deeds", "handling", "states")
    words = {name: word_set(said[name]) for name in (*sets, "harmless", "aside", "nouns", "wishes")}
    return English(
        turned=_phrases(said["turned"]),
        compared=by_word(said["compared"]),
        relations=relations,
        selecting=by_word(said["selecting"]),
        kinds={kind: word_set(members) for kind, members in said["kinds"].items()},
        same=tuple(word_set(line) for line in said["same"]),
        purposes=purposes,
        **words,
    )


@cache
def language(code: str) -> Language:
    """One of `LANGUAGES`."""
    said = _read(code)
    endings = tuple(said["endings"].split())
    compounds = bool(said.get("compounds", False))
    return Language(_phrases(said["turned"]), endings, compounds)


@cache
def tells() -> Mapping[str, frozenset[str]]:
    """Frequent small words by which each of `LANGUAGES` is told from others."""
    return {code: word_set(words) for code, words in _read("tells").items()}


def _read(code: str) -> dict[str, Any]:
    file = files("palpate.planning.request").joinpath("words", f"{code}.yaml")
    text = file.read_text(encoding="utf-8")
    return plain_yaml(text, f"words of '{code}'")


def _phrases(turned: Mapping[str, str]) -> dict[Phrase, Phrase]:
    return {tuple(phrase.split()): tuple(said.split()) for phrase, said in turned.items()}


def longest(table: Iterable[Phrase]) -> int:
    """Words of the longest phrase."""
    return max(map(len, table), default=0)
