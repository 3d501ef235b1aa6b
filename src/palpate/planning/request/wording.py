"""The words of `words/*.yaml`, as what reads requests looks them up."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from palpate.files.plain_yaml import plain_yaml
from palpate.planning.request.lexicon import by_word, word_set
from palpate.quantities.purposes import quantities_by_verb

LANGUAGES = ("de", "es", "fr", "it")
"""Languages of requests, without English."""

Phrase = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Language:
    """A language that requests may be written in.

    Attributes:
        turned: its phrases in English.
        endings: of inflected words, which may be left away.
        compounds: whether it writes several nouns in one word.
        plurals: endings of plurals, and what they are of.
    """

    turned: Mapping[Phrase, Phrase]
    endings: tuple[str, ...]
    compounds: bool
    plurals: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class English:
    """Word classes of English, from `words/en.yaml`.

    Attributes:
        classes: the classes of a phrase, and whether it inflects.
        single: first words of all phrases.
        irregular: forms of verbs that no ending tells, with the verb and the form.
    """

    turned: Mapping[Phrase, Phrase]
    classes: Mapping[Phrase, tuple[tuple[str, bool], ...]]
    single: frozenset[str]
    irregular: Mapping[str, tuple[str, str]]
    numbers: Mapping[str, str]
    compared: Mapping[str, str]
    superlatives: frozenset[str]
    relations: Mapping[Phrase, str]
    selecting: Mapping[str, str]
    kinds: Mapping[str, frozenset[str]]
    collective: frozenset[str]
    same: tuple[frozenset[str], ...]
    purposes: Mapping[str, tuple[str, ...]]
    describing: frozenset[str]
    asked: Mapping[str, str]
    often: frozenset[str]
    turning: frozenset[str]
    remarking: frozenset[str]
    telling: frozenset[str]
    asking: frozenset[str]
    bearing: frozenset[str]
    harmless: frozenset[str]
    remaining: frozenset[str]
    settled: frozenset[str]
    denying: frozenset[str]
    materials: Mapping[str, str]
    things: frozenset[str]


@cache
def english() -> English:
    """The words of English requests."""
    said = _read("en")
    classes = _classes(said["classes"], said["verbs"])
    relations: dict[Phrase, Any] = {}
    for relation, phrases in said["relations"].items():
        relations |= dict.fromkeys(_listed(phrases), relation)
    sets = (
        "collective",
        "superlatives",
        "describing",
        "things",
        "often",
        "turning",
        "remarking",
        "telling",
        "asking",
        "bearing",
        "harmless",
        "remaining",
        "settled",
        "denying",
    )
    words = {name: word_set(said[name]) for name in sets}
    return English(
        turned=_phrases(said["turned"]),
        classes=classes,
        single=frozenset(phrase[0] for phrase in classes),
        irregular={form: _form(told) for form, told in said["irregular"].items()},
        numbers={word: str(number) for word, number in said["numbers"].items()},
        compared=by_word(said["compared"]),
        relations=relations,
        asked=by_word(said["asked"]),
        selecting=by_word(said["selecting"]),
        kinds={kind: word_set(members) for kind, members in said["kinds"].items()},
        same=tuple(word_set(line) for line in said["same"]),
        purposes=quantities_by_verb(),
        materials=said["materials"],
        **words,
    )


@cache
def language(code: str) -> Language:
    """Words of one of `LANGUAGES`."""
    said = _read(code)
    endings = tuple(said["endings"].split())
    compounds = bool(said.get("compounds", False))
    plurals = dict(said.get("plurals", {}))
    return Language(_phrases(said["turned"]), endings, compounds, plurals)


@cache
def tells() -> Mapping[str, frozenset[str]]:
    """Frequent small words by which languages are distinguished."""
    return {code: word_set(words) for code, words in _read("tells").items()}


def longest(table: Iterable[Phrase]) -> int:
    """Words of the longest phrase."""
    return max(map(len, table), default=0)


def _classes(
    plain: Mapping[str, str], verbs: Mapping[str, str]
) -> dict[Phrase, tuple[tuple[str, bool], ...]]:
    found: dict[Phrase, list[tuple[str, bool]]] = defaultdict(list)
    for inflects, classes in ((False, plain), (True, verbs)):
        for kind, phrases in classes.items():
            for phrase in dict.fromkeys(_listed(phrases)):
                found[phrase].append((kind, inflects))
    return {phrase: tuple(kinds) for phrase, kinds in found.items()}


def _listed(phrases: str) -> list[Phrase]:
    return [tuple(phrase.split()) for phrase in phrases.split(",") if phrase.strip()]


def _form(told: str) -> tuple[str, str]:
    """A verb and its form: "find ED"; the past, which nothing asks for, has none."""
    verb, _, form = told.partition(" ")
    return verb, f"_{form}" if form else ""


def _read(code: str) -> dict[str, Any]:
    file = files("palpate.planning.request").joinpath("words", f"{code}.yaml")
    text = file.read_text(encoding="utf-8")
    return plain_yaml(text, f"words of '{code}'")


def _phrases(turned: Mapping[str, str]) -> dict[Phrase, Phrase]:
    return {tuple(phrase.split()): tuple(said.split()) for phrase, said in turned.items()}
