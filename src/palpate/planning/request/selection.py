"""Selection of the bodies in a request."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from palpate.common.errors import InputError
from palpate.common.parameter import PlanRejected
from palpate.mjcf.body import Body
from palpate.planning.request.query import (
    GRIPPER,
    Again,
    All,
    Except,
    Extreme,
    Item,
    Kind,
    Names,
    Near,
    Selector,
    Several,
)
from palpate.planning.request.whereabouts import farthest, standing
from palpate.planning.request.words import english, is_further, is_within, name_words, singulars
from palpate.scene.scene import Scene


class Nouns:
    """Words for the bodies of one scene.

    Attributes:
        own: words of each body's name.
        named: bodies by the words of their name.
        colours: colour words, which are no nouns.
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
        """Words of all names."""
        return self._names

    def apart(self, request: str) -> str:
        """Split the body names in a request into words: "cubeB_main" becomes "cube b main"."""
        # Longest names first, because a short name may be part of a long one.
        for name in sorted(self.own, key=len, reverse=True):
            if len(self.own[name]) > 1:
                words = " ".join(self.own[name])
                request = re.sub(rf"(?<!\w){re.escape(name)}(?!\w)", words, request)
        return request

    def known(self, word: str) -> bool:
        """True if a word may be part of a body's name."""
        forms = singulars(word)
        if not self._said_of_any.isdisjoint([*forms, *_others(word)]):
            return True
        return any(_ends(own, form) for own in self._names for form in forms)

    def is_kind(self, word: str) -> bool:
        """True for a class of objects that is part of no name."""
        forms = singulars(word)
        return self._names.isdisjoint(forms) and not english().kinds.keys().isdisjoint(forms)

    def singular(self, word: str) -> bool:
        """True if a word is no plural; words of names are singular."""
        alike = word in self._said_of_any or word in frozenset[str]().union(*english().same)
        return alike or any(_ends(own, word) for own in self._names)

    def fitting(self, words: Sequence[str]) -> tuple[str, ...]:
        """Return the bodies that all `words` describe.

        If the last word is part of some of their names, only these bodies are returned.
        """
        fitting = [name for name in self.own if self._fits(name, words)]
        noun = singulars(words[-1])
        called = [name for name in fitting if not set(self.own[name]).isdisjoint(noun)]
        return tuple(called or fitting)

    def meant(self, words: tuple[str, ...], plural: bool) -> tuple[str, ...]:
        """Return the bodies that `words` may refer to.

        The order is: exact name, noun as head of a name, all words describe the body, synonym.
        """
        exact = self.named.get(words)
        if exact and not plural:
            return tuple(exact)
        if self._is_gripper(words[-1]):
            return (GRIPPER,)
        return self._names_with_head(self.fitting(words), words[-1]) or self._bodies_by_synonym(
            words
        )

    def _names_with_head(self, names: Sequence[str], noun: str) -> tuple[str, ...]:
        """Select the names with head noun `noun`: "paint" does not select a paint can."""
        return tuple(name for name in names if self._may_head(name, noun))

    def _may_head(self, name: str, noun: str) -> bool:
        # Ignore additions after a parenthesis or comma: "stapler (old)".
        headed = name_words(re.split(r"[(,]", name)[0]) or self.own[name]
        # Suffixes without a meaning and colours are no head nouns.
        own = [word for word in headed if not is_further(word)]
        own = [word for word in own if word not in self.colours] or own
        said = set(singulars(noun))
        return said.isdisjoint(own[:-1]) or not said.isdisjoint(own[-1:])

    def is_synonym(self, words: tuple[str, ...]) -> bool:
        """True if `words` are a synonym of a body rather than its name."""
        return not self.named.get(words) and not self._names_with_head(
            self.fitting(words), words[-1]
        )

    def _bodies_by_synonym(self, words: tuple[str, ...]) -> tuple[str, ...]:
        """Return the bodies of a synonym: the desk for "table" if there is no table."""
        found: list[str] = []
        for other in _others(words[-1]):
            found += self._names_with_head(self.fitting((*words[:-1], other)), other)
        return tuple(dict.fromkeys(found))

    def _said_of(self, body: Body) -> frozenset[str]:
        """Return every word that may describe a body: its name, appearance and kind."""
        own = self.own[body.name]
        # Words of the name and of the role, then of the appearance.
        said = set(own) | _KINDS[body.role]
        for phrase in body.words:
            said.update(phrase.split())
        # Classes of objects to which the name belongs: "mug" is a "vessel", for example.
        for kind, members in english().kinds.items():
            if any(_ends(word, member) for word in own for member in members):
                said.add(kind)
        return frozenset(said)

    def _is_gripper(self, noun: str) -> bool:
        """True if the noun refers to the robot's hand and no body has that name."""
        return noun in _GRIPPER and noun not in self._names

    def _fits(self, name: str, words: Sequence[str]) -> bool:
        """True if each of `words` may describe the body."""
        return all(self._says(name, word) for word in words)

    def _says(self, name: str, word: str) -> bool:
        forms = singulars(word)
        if not self._said[name].isdisjoint(forms):
            return True
        return any(_ends(own, form) for own in self.own[name] for form in forms)


def _ends(own: str, noun: str) -> bool:
    """True if a word of a name is the noun, or a compound that ends in it."""
    return noun == own or (noun in own and is_within(noun, own))


def _others(noun: str) -> Iterator[str]:
    """Yield synonyms of a noun."""
    for form in singulars(noun):
        for alike in english().same:
            if form in alike:
                yield from alike - {form}


OBJECT_NOUNS = frozenset({"object", "thing", "item", "body"})
"""Nouns for any object."""
_KINDS: Mapping[str, frozenset[str]] = {
    "object": OBJECT_NOUNS,
    "surface": frozenset({"surface"}),
    "fixture": frozenset({"fixture"}),
}
_GRIPPER = frozenset({"gripper", "hand", "arm", "robot"})


# Resolution of selectors to bodies of the scene.


Items = tuple[Item, ...]


@dataclass
class Selection:
    """Resolver of selectors, with the history of mentions.

    Attributes:
        scene: the scene.
        nouns: its nouns.
        spoken: the bodies of every earlier mention, as references of "it".
        spared: the excluded bodies.
        remarks: interpretations that differ from the literal words.
        unsure: a sentence was set aside since the last mention, which "it" may refer to.
    """

    scene: Scene
    nouns: Nouns
    spoken: list[Items] = field(default_factory=list[Items])
    spared: list[Item] = field(default_factory=list[Item])
    remarks: list[str] = field(default_factory=list[str])
    unsure: bool = False

    def found(self, selector: Selector) -> Items:
        """Resolve a selector and add it to the mentions.

        Raises:
            InputError: the scene has no such body.
            PlanRejected: the selector is ambiguous.
        """
        found = tuple(self._items(selector))
        self.remarks += [item.remark for item in found if item.remark]
        if found and not (isinstance(selector, Again) and selector.which != "one"):
            self.spoken.append(found)
            self.unsure = False
        return found

    def _items(self, selector: Selector) -> Iterator[Item]:
        match selector:
            case All():
                yield self._everything(selector.others)
            case Names():
                yield self._resolve_name(selector.words)
            case Kind():
                yield self._kind(selector)
            case Except():
                yield from self._less(selector)
            case Near():
                yield self._resolve_place(selector)
            case Extreme():
                yield self._farthest(selector)
            case Again(which="one"):
                yield self._one(selector.words)
            case Again():
                yield from self._resolve_earlier(selector.which)
            case Several(choice=True):
                raise PlanRejected("'or' leaves it open which is meant; say 'and', or name one")
            case Several():
                for one in selector.parts:
                    yield from self.found(one)

    def _everything(self, others: bool) -> Item:
        # "The others" excludes all bodies mentioned or excluded before.
        names = tuple(self.scene.bodies)
        if others:
            self.require_sure()
            before = {
                name for items in [*self.spoken, self.spared] for i in items for name in i.names
            }
            names = tuple(name for name in names if name not in before)
        return Item(("everything",), names, plural=True)

    def _resolve_name(self, words: tuple[str, ...]) -> Item:
        names = (GRIPPER,) if GRIPPER in words else self.nouns.meant(words, plural=False)
        if not names:
            raise self._not_there(" ".join(words))
        # A general noun such as "object" refers to the last mentioned body.
        if len(names) > 1 and len(words) == 1 and words[0] in OBJECT_NOUNS:
            names = self._last(names)
        remark = f"'{' '.join(words)}' is taken for {_quote_names(names)}."
        return Item(words, names, remark=remark if self.nouns.is_synonym(words) else "")

    def _last(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """Return the last mentioned body for "that thing"."""
        if not self.spoken or self.unsure or len(self.spoken[-1]) > 1:
            return names
        return tuple(name for item in self.spoken[-1] for name in item.names)

    def _kind(self, kind: Kind) -> Item:
        said, names = " ".join(kind.words), self.nouns.meant(kind.words, plural=True)
        if not names:
            raise self._not_there(said)
        # A stated number must equal the number of bodies.
        if kind.count and len(names) != int(kind.count):
            raise PlanRejected(
                f"the scene has {len(names)} of '{said}', not {kind.count}: {', '.join(names)}; name "
                "those that are meant"
            )
        taken = self.nouns.is_synonym(kind.words) or self.nouns.is_kind(kind.words[-1])
        remark = f"'{said}' are taken to be {_quote_names(names)}." if taken else ""
        return Item(kind.words, names, True, remark)

    def _one(self, words: tuple[str, ...]) -> Item:
        """Resolve "the red one": of the last mentioned kind, else any object."""
        for items in reversed(self.spoken):
            # The noun is that of an earlier mention, latest first.
            said = (*words, items[-1].words[-1])
            names = self.nouns.meant(said, plural=True)
            if names:
                return Item(said, names)
        names = self.nouns.fitting((*words, "object"))
        if not names:
            raise self._not_there(f"{' '.join(words)} one")
        return Item((*words, "one"), names)

    def _resolve_earlier(self, which: str) -> Items:
        """Return the bodies named before."""
        self.require_sure()
        # Without an earlier mention, only "all" has a reference.
        if not self.spoken:
            if which == "all":
                return (self._everything(others=False),)
            raise PlanRejected("'it' stands for nothing that was named; name the object")
        # "All" after a single body refers to everything.
        last = self.spoken[-1]
        if which == "all" and len([name for item in last for name in item.names]) < 2:
            return (self._everything(others=False),)
        if which == "it" and len(last) > 1:
            raise PlanRejected(f"'it' may be {' or '.join(item.text for item in last)}; name one")
        return last

    def require_sure(self) -> None:
        """Require that no sentence was set aside between a pronoun and its reference.

        Raises:
            PlanRejected: a sentence was set aside and may contain the reference.
        """
        if self.unsure:
            raise PlanRejected("it is not clear what 'it' stands for here; name the object")

    def _farthest(self, extreme: Extreme) -> Item:
        item = self._kind(extreme.base)
        if len(item.names) == 1:
            return replace(item, plural=False)
        name, remark = farthest(extreme.place, item.names, self.scene, item.text)
        return Item(item.words, (name,), remark=remark)

    def _resolve_place(self, near: Near) -> Item:
        (item,) = self._items(near.base)
        # The top of a surface is the surface; other tops are parts.
        if near.relation == "top":
            if self.scene.surfaces.keys().isdisjoint(item.names):
                raise PlanRejected(f"the top of '{item.text}' is a part of it; name the whole")
            return item
        # Resolve the landmarks, then select by the relation to them.
        marks = [name for mark in near.marks for name in self._each(mark)]
        anything = isinstance(near.base, All)
        names, remark = standing(near.relation, item, marks, self.scene, anything)
        return Item(item.words, names, item.plural, remark or item.remark)

    def _each(self, selector: Selector) -> Iterator[str]:
        """Yield the names of the bodies of a selector."""
        for item in self._items(selector):
            if len(item.names) > 1 and not item.plural:
                choices = " or ".join(f"'{name}'" for name in item.names)
                raise PlanRejected(f"'the {item.text}' may be {choices}; name one")
            yield from item.names

    def _less(self, selector: Except) -> Iterator[Item]:
        items = tuple(self._items(selector.base))
        self.spoken.append(items)  # references of "the red one"
        less = set(self._each(selector.less))
        self.spoken.pop()
        self.spared.append(Item((), tuple(less), plural=True))
        # A singular body cannot be both wanted and excluded.
        single = {name for item in items if not item.plural for name in item.names}
        if not less.isdisjoint(single):
            raise PlanRejected(
                f"{_quote_names(sorted(less & single))} is both wanted and not wanted"
            )
        for item in items:
            kept = tuple(name for name in item.names if name not in less)
            if kept:
                yield replace(item, names=kept)

    def _not_there(self, words: str) -> InputError:
        listed = ", ".join(self.scene.bodies) or "no objects at all"
        why = self.scene.resolved.description.why_no_body(words)
        return InputError(f"the scene has no '{words}'; it has {listed}{why and '. ' + why}")


def _quote_names(names: Iterable[str] | Sequence[str]) -> str:
    return " and ".join(f"'{name}'" for name in names)
