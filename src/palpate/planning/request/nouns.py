"""Bodies of a scene that a noun may refer to."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence

from palpate.mjcf.body import Body
from palpate.planning.request.item import GRIPPER
from palpate.planning.request.tokens import is_further, is_within, name_words, singulars
from palpate.planning.request.wording import english
from palpate.scene.scene import Scene


class Nouns:
    """The words that name things in one scene.

    Attributes:
        own: the words of each body's name.
        named: which bodies are called so.
        colours: words of colours, which are no nouns.
    """

    def __init__(self, scene: Scene, colours: frozenset[str]) -> None:
        self.colours = colours
        self.own = {name: name_words(name) for name in scene.bodies}
        self.named: dict[tuple[str, ...], list[str]] = defaultdict(list)
        for name, own in self.own.items():
            self.named[own].append(name)
        self._said = {name: self._said_of(body) for name, body in scene.bodies.items()}
        self._names = frozenset(word for own in self.own.values() for word in own)
        self._said_of_any = frozenset[str]().union(
            self.colours, *_KINDS.values(), _GRIPPER, *self._said.values()
        )

    @property
    def names(self) -> frozenset[str]:
        """The words of all names."""
        return self._names

    def apart(self, request: str) -> str:
        """The request with the names of bodies, as the scene writes them, in words: "cubeB_main" is
        "cube b main"."""
        for name in sorted(self.own, key=len, reverse=True):
            if len(self.own[name]) > 1:
                words = " ".join(self.own[name])
                request = re.sub(rf"(?<!\w){re.escape(name)}(?!\w)", words, request)
        return request

    def known(self, word: str) -> bool:
        """Test that a word may be part of the name of a body here."""
        forms = singulars(word)
        if not self._said_of_any.isdisjoint([*forms, *_others(word)]):
            return True
        return any(_ends(own, form) for own in self._names for form in forms)

    def is_kind(self, word: str) -> bool:
        """Test for a word that is a class of objects and part of no name."""
        forms = singulars(word)
        return self._names.isdisjoint(forms) and not english().kinds.keys().isdisjoint(forms)

    def singular(self, word: str) -> bool:
        """Test that a word is no plural, as names and their own words are."""
        alike = word in self._said_of_any or word in frozenset[str]().union(*english().same)
        return alike or any(_ends(own, word) for own in self._names)

    def fitting(self, words: Sequence[str]) -> tuple[str, ...]:
        """All bodies of which each of `words` may be said; where the last is in some of their names,
        those."""
        fitting = [name for name in self.own if self._fits(name, words)]
        noun = singulars(words[-1])
        called = [name for name in fitting if not set(self.own[name]).isdisjoint(noun)]
        return tuple(called or fitting)

    def meant(self, words: tuple[str, ...], plural: bool) -> tuple[str, ...]:
        """The bodies that `words` may mean: the one called exactly so, else those whose name has
        the noun, else those of which all words may be said, else what has another word for it."""
        exact = self.named.get(words)
        if exact and not plural:
            return tuple(exact)
        if self._is_gripper(words[-1]):
            return (GRIPPER,)
        return self._headed(self.fitting(words), words[-1]) or self._otherwise(words)

    def _headed(self, names: Sequence[str], noun: str) -> tuple[str, ...]:
        """Select the names whose head noun is `noun`: paint is no paint can."""
        return tuple(name for name in names if self._may_head(name, noun))

    def _may_head(self, name: str, noun: str) -> bool:
        # What a parenthesis or a comma adds is no noun: "stapler (old)".
        headed = name_words(re.split(r"[(,]", name)[0]) or self.own[name]
        own = [word for word in headed if not is_further(word)]
        own = [word for word in own if word not in self.colours] or own
        said = set(singulars(noun))
        return said.isdisjoint(own[:-1]) or not said.isdisjoint(own[-1:])

    def otherwise(self, words: tuple[str, ...]) -> bool:
        """Test that `words` are synonyms of a body, and not its own name."""
        return not self.named.get(words) and not self._headed(self.fitting(words), words[-1])

    def _otherwise(self, words: tuple[str, ...]) -> tuple[str, ...]:
        """Bodies that a synonym refers to: the table for a desk if there is no table."""
        found: list[str] = []
        for other in _others(words[-1]):
            found += self._headed(self.fitting((*words[:-1], other)), other)
        return tuple(dict.fromkeys(found))

    def _said_of(self, body: Body) -> frozenset[str]:
        """Every word that may be said of a body: of its name, its looks and its kind."""
        own = self.own[body.name]
        said = set(own) | _KINDS[body.role]
        for phrase in body.words:
            said.update(phrase.split())
        for kind, members in english().kinds.items():
            if any(_ends(word, member) for word in own for member in members):
                said.add(kind)
        return frozenset(said)

    def _is_gripper(self, noun: str) -> bool:
        """Test that the noun means the robot's hand, and no body of that name exists."""
        return noun in _GRIPPER and noun not in self._names

    def _fits(self, name: str, words: Sequence[str]) -> bool:
        """Test that each of `words` may describe the body."""
        return all(self._says(name, word) for word in words)

    def _says(self, name: str, word: str) -> bool:
        forms = singulars(word)
        if not self._said[name].isdisjoint(forms):
            return True
        return any(_ends(own, form) for own in self.own[name] for form in forms)


def _ends(own: str, noun: str) -> bool:
    """Test that a word of a name is the noun, or a compound that ends in it."""
    return noun == own or (noun in own and is_within(noun, own))


def _others(noun: str) -> Iterator[str]:
    """Other words for a noun."""
    for form in singulars(noun):
        for alike in english().same:
            if form in alike:
                yield from alike - {form}


OBJECT_NOUNS = frozenset({"object", "thing", "item", "body"})
"""Nouns that fit any object."""
_KINDS: Mapping[str, frozenset[str]] = {
    "object": OBJECT_NOUNS,
    "surface": frozenset({"surface"}),
    "fixture": frozenset({"fixture"}),
}
_GRIPPER = frozenset({"gripper", "hand", "arm", "robot"})
