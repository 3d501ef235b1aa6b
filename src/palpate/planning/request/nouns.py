"""Words for the bodies of one scene, in five languages."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from palpate.mjcf.body import Body
from palpate.planning.request.query import GRIPPER
from palpate.planning.request.words import EXACT, kinds, languages, singulars, without_accents
from palpate.scene.scene import Scene

LONGEST_NAME = 6
"""Maximum number of words that describe a body."""
_HUES = "red green blue light yellow orange purple pink brown black white grey"
COLOURS = frozenset(f"+{hue}" for hue in _HUES.split())
_FURTHER = re.compile(r"(?:body|base|top|link|obj|object|geom|mesh|part|main|root|\d)+")
"""Suffixes of model names without a meaning."""
_COLLECTIVE = frozenset({"fruit", "stationery", "glassware", "cutlery", "obst", "geschirr"})
_HAND = frozenset({"gripper", "hand", "arm", "robot"})
_BEFORE = re.compile(r"(?=.*[aeiouy])\w{3,}")
"""Valid prefixes of compound nouns: `work` of `bench`, but not `sp` of `ring`."""


@dataclass(frozen=True, slots=True)
class Phrase:
    """Words that describe bodies.

    Attributes:
        length: number of words.
        names: the bodies that they may mean; empty for a known noun without a body.
        plural: the noun is a plural.
        noun: the phrase has a noun; a mere adjective needs that of another phrase.
        inexact: the noun is a synonym or a class of the bodies' names.
    """

    length: int
    names: tuple[str, ...]
    plural: bool = False
    noun: bool = True
    inexact: bool = False


class _Words:
    """Words for one body: those of its name (`own`), its possible nouns (`heads`), and others.

    `shapes` are further English words, and `usual` the concepts of its noun.
    """

    def __init__(self, body: Body) -> None:
        self.own, self.role = name_words(body.name), body.role
        plain = name_words(re.split(r"[(,]", body.name)[0]) or self.own
        # The noun is the last word that is neither an adjective nor a suffix without a meaning.
        nouns = [word for word in plain if len(word) > 1 and not _FURTHER.fullmatch(word)]
        nouns = [word for word in nouns if not _is_adjective(word)] or nouns or list(plain)
        self.heads = frozenset(nouns[-1:])
        self.said = frozenset(self.own) | {part for word in body.words for part in word.split()}
        self.shapes = self.said - frozenset(self.own)
        whole = "_".join(self.own)
        self.concepts = frozenset(c for word in {*self.said, whole} for c in _all_concepts(word))
        self.usual = frozenset(c for w in (*self.heads, whole) for c in _all_concepts(w))


class Nouns:
    """Words for the bodies of a scene, as said in one language."""

    def __init__(self, scene: Scene) -> None:
        self.words: Mapping[str, _Words] = {n: _Words(body) for n, body in scene.bodies.items()}
        self.names = frozenset(word for one in self.words.values() for word in one.own)

    def split_names(self, request: str) -> str:
        """Split the body names in a request into words: "cubeB_main" becomes "cube b main"."""
        for name in sorted(self.words, key=len, reverse=True):
            if len(self.words[name].own) > 1:
                words = " ".join(self.words[name].own)
                request = re.sub(rf"(?<!\w){re.escape(name)}(?!\w)", words, request, flags=re.I)
        return request

    def match(self, said: Sequence[str], at: int, code: str) -> Phrase | None:
        """Return the longest description of a body that begins at a position."""
        # An exact name, longest first.
        for length in range(LONGEST_NAME, 0, -1):
            part = tuple(said[at : at + length])
            exact = tuple(name for name, one in self.words.items() if one.own == part)
            if exact and len(part) == length:
                return Phrase(length, exact)
        best: Phrase | None = None
        for length in range(1, LONGEST_NAME + 1):
            part = said[at : at + length]
            known = _concepts(part[-1], code) or self._distinguishes(part[-1], code)
            if len(part) < length or not known:
                break
            # In English and German, no adjective follows its noun.
            noun = best is not None and best.noun and code in ("en", "de")
            if noun and not part[-1].isdigit() and not self._is_noun(part[-1], code):
                break
            found = self.find(part, code)
            best = found or best
        return best

    def find(self, part: Sequence[str], code: str) -> Phrase | None:
        """Return the bodies that all words describe; None if one word describes nothing."""
        ranks = {name: self._rank(name, part, code) for name in self.words}
        fitting = {name: rank for name, rank in ranks.items() if rank is not None}
        noun = any(self._is_noun(word, code) for word in part)
        heads = {name: rank for name, rank in fitting.items() if rank < _ADJECTIVE}
        if noun:
            least = min(heads.values(), default=0)
            names = tuple(name for name, rank in heads.items() if rank == least)
            # "The shampoo" may mean the shampoo bottle, if there is no other.
            inexact = not names and (len(fitting) == 1 or bool(self._loosely(part, code)))
            names = (tuple(fitting) or self._loosely(part, code)) if inexact else names
            if not names and part[-1] in _HAND and part[-1] not in self.names:
                names = (GRIPPER,)
            plural = part[-1] in _COLLECTIVE or self._is_plural(part, names, code)
            return Phrase(len(part), names, plural, True, inexact or (bool(names) and least > 0))
        if all(_concepts(word, code) or self._distinguishes(word, code) for word in part):
            return Phrase(len(part), tuple(fitting), False, False)
        return None

    def _loosely(self, part: Sequence[str], code: str) -> tuple[str, ...]:
        """Return the bodies of which a translation ends with a noun: "Stein" for "Ziegelstein"."""
        if len(part) > 1 or len(part[0]) <= EXACT:
            return ()
        nouns = [(noun, c) for noun, c in languages()[code].nouns.items() if noun != part[0]]
        ends = [c for noun, c in nouns if noun.endswith(part[0]) or noun.split("_")[0] == part[0]]
        return tuple(n for n, one in self.words.items() if any(one.usual & set(c) for c in ends))

    def _is_plural(self, part: Sequence[str], names: Sequence[str], code: str) -> bool:
        """True if the noun is a plural, which is neither a name nor a known singular."""
        for word in part:
            if not self._is_noun(word, code) or word in self.names or word.isdigit():
                continue
            known = languages()[code].nouns
            if not {word, without_accents(word)} & known.keys() and any(
                form in known
                or f"{form}*" in known
                or form in self.names
                or any(_ends(own, form) for own in self.names)
                for form in (*singulars(word), *singulars(without_accents(word)))
            ):
                return True
        return False

    def _is_noun(self, word: str, code: str) -> bool:
        concepts = _concepts(word, code)
        if any(not one.startswith("+") for one in concepts):
            return True
        ranks = (self._word_rank(one, word, code) for one in self.words.values())
        return any(rank is not None and rank < _ADJECTIVE for rank in ranks) and not concepts

    def _rank(self, name: str, part: Sequence[str], code: str) -> int | None:
        """Return how directly the words name a body, 0 for its own noun; None if one excludes it."""
        best = _ADJECTIVE
        for word in part:
            rank = self._word_rank(self.words[name], word, code)
            if rank is None:
                concepts = _concepts(word, code)
                soft = concepts and all(one.startswith("+") for one in concepts)
                if not soft or not COLOURS.isdisjoint(concepts) or self._distinguishes(word, code):
                    return None
                continue
            best = min(best, rank)
        return best

    def _distinguishes(self, word: str, code: str) -> bool:
        """True if the word describes some body of the scene."""
        return any(self._word_rank(one, word, code) is not None for one in self.words.values())

    def _word_rank(self, one: _Words, word: str, code: str) -> int | None:
        """Return how directly a word names a body: own noun, usual concept, concept, kind, other."""
        forms = singulars(word, code == "en")
        forms = tuple(dict.fromkeys((*forms, *map(without_accents, forms))))
        if not one.heads.isdisjoint(forms):
            return 0
        # A word with another use is no part of a compound: "and" of "washstand".
        if not languages()[code].match([word], 0)[0] and any(
            _ends(own, form) for own in one.heads for form in forms
        ):
            return 0
        concepts = _concepts(word, code)
        nouns = [concept for concept in concepts if not concept.startswith("+")]
        for rank, concept in enumerate(nouns):
            if concept in one.usual:
                return 1 + min(rank, 1)
        for concept in nouns:
            members = kinds().get(concept, ())
            if any(
                _ends(own, form) for own in one.own for form in members
            ) or not one.usual.isdisjoint(members):
                return 3
        if "object" in concepts and one.role == "object":
            return 3
        if word in ("surface", "fixture") and word == one.role:
            return 3
        if not one.shapes.isdisjoint(forms):
            return 4 if nouns else _ADJECTIVE
        if not one.said.isdisjoint(forms) or not one.concepts.isdisjoint(concepts):
            return _ADJECTIVE
        return None


_ADJECTIVE = 9
"""Rank of a word that describes a body without naming it."""


def _concepts(word: str, code: str) -> tuple[str, ...]:
    """Return the concepts of a word of a request; unknown words may be English."""
    language = languages()[code]
    found = language.concepts(word)
    if found or code == "en" or language.match([word], 0)[0]:
        return found
    return languages()["en"].concepts(word)


def name_words(name: str) -> tuple[str, ...]:
    """Split a body name into words: `light_blue_box` and `LightBlueBox` are equal."""
    return tuple(re.findall(r"[^\W_]+", re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", name).lower()))


def _all_concepts(word: str) -> tuple[str, ...]:
    """Return the concepts of a word of a name in all languages."""
    forms = {word, word.replace("ue", "u").replace("oe", "o").replace("ae", "a")}
    return tuple(
        concept
        for form in forms
        for each in languages().values()
        for concept in each.concepts(form)
    )


def _is_adjective(word: str) -> bool:
    concepts = _all_concepts(word)
    return bool(concepts) and all(one.startswith("+") for one in concepts)


def _ends(own: str, noun: str) -> bool:
    """True if a word of a name is the noun, or a compound with it as head."""
    if noun == own:
        return True
    if len(noun) < 3 or noun not in own:
        return False
    # The noun comes first with a meaningless suffix, or last in a compound.
    if own.startswith(noun) and _FURTHER.fullmatch(own.removeprefix(noun)):
        return True
    return own.endswith(noun) and bool(_BEFORE.fullmatch(own.removesuffix(noun)))
