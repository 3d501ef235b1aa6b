"""Bodies of the scene that the things of a request refer to."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from palpate.errors import InputError, PlanRejected
from palpate.planning.request.item import GRIPPER, Item
from palpate.planning.request.lexicon import OBJECT_NOUNS
from palpate.planning.request.nouns import Nouns
from palpate.planning.request.sentence.meaning import (
    Absent,
    Again,
    But,
    Choice,
    Chosen,
    Coloured,
    Everything,
    Named,
    Placed,
    Several,
    Thing,
    Top,
)
from palpate.planning.request.whereabouts import farthest, standing
from palpate.scene.scene import Scene

Items = tuple[Item, ...]


@dataclass
class Things:
    """Resolver of things, with the history of mentions.

    Attributes:
        spoken: the things of every list so far, which "it" may mean.
        spared: those that were not wanted.
        remarks: how things were read that were not quite said so.
        unsure: whether something was said since that nobody looked into.
    """

    scene: Scene
    nouns: Nouns
    spoken: list[Items] = field(default_factory=list[Items])
    spared: list[Item] = field(default_factory=list[Item])
    remarks: list[str] = field(default_factory=list[str])
    unsure: bool = False

    def found(self, thing: Thing) -> Items:
        """Resolve a thing and add it to the mentions.

        Raises:
            InputError: the scene has no such thing. PlanRejected: it cannot be told which it is.
        """
        found = tuple(self._items(thing))
        self.remarks += [item.remark for item in found if item.remark]
        if found and not isinstance(thing, Again):
            self.spoken.append(found)
            self.unsure = False
        return found

    def _items(self, thing: Thing) -> Iterator[Item]:
        match thing:
            case Named():
                yield self._named(thing)
            case Coloured():
                yield self._coloured(thing)
            case Absent():
                raise self._not_there(" ".join(thing.words))
            case Again():
                yield from self._again(thing.which)
            case Everything():
                yield self._everything(thing)
            case Choice():
                raise PlanRejected("'or' leaves it open which is meant; say 'and', or name one")
            case Several():
                for one in thing.things:
                    yield from self.found(one)
            case Chosen():
                yield self._chosen(thing)
            case Placed():
                yield self._placed(thing)
            case But():
                yield from self._less(thing)
            case Top():
                yield from self._top(thing)

    def _named(self, thing: Named) -> Item:
        words, several = thing.words, thing.many not in ("one", "any")
        names = self.nouns.meant(words, plural=several)
        if GRIPPER in words:
            names = (GRIPPER,)
        if not names:
            raise self._not_there(" ".join(words))
        if thing.many == "other":
            names = self._others_of(names)
        if not several and len(names) > 1 and words[-1] in OBJECT_NOUNS and len(words) == 1:
            names = self._last(names)
        if thing.many.isdigit() and len(names) != int(thing.many):
            raise PlanRejected(
                f"the scene has {len(names)} of '{' '.join(words)}', not {thing.many}: "
                f"{', '.join(names)}; name those that are meant"
            )
        if thing.told:
            self._require_only(words, thing.told)
            self.remarks.append(f"'{thing.told}' is taken for a side remark.")
        remark = ""
        if self.nouns.otherwise(words):
            remark = f"'{' '.join(words)}' is taken for {_quoted(names)}."
        elif several and self.nouns.is_kind(words[-1]):
            remark = f"'{' '.join(words)}' are taken to be {_quoted(names)}."
        return Item(words, names, several, remark)

    def _require_only(self, words: tuple[str, ...], told: str) -> None:
        """Require that a relative clause need not distinguish several bodies.

        Raises:
            PlanRejected: it does: "the box that I like best".
        """
        names = self.nouns.meant(words, plural=True)
        if len(names) > 1:
            raise PlanRejected(
                f"'{told}' does not tell which of {', '.join(names)} is meant; name it"
            )

    def _last(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """ "That thing": the one that was spoken of last."""
        if not self.spoken or self.unsure or len(self.spoken[-1]) > 1:
            return names
        return tuple(name for item in self.spoken[-1] for name in item.names)

    def _others_of(self, names: Sequence[str]) -> tuple[str, ...]:
        """Bodies that were not mentioned.

        Raises:
            PlanRejected: none was.
        """
        self.require_sure()
        before = {name for item in self._before() for name in item.names}
        others = tuple(name for name in names if name not in before)
        if not before.intersection(names) or not others:
            raise PlanRejected(f"which is the other of {', '.join(names)}? name one")
        return others

    def _before(self) -> list[Item]:
        return [item for items in self.spoken for item in items] + self.spared

    def _coloured(self, thing: Coloured) -> Item:
        """ "The red one": of the kind spoken of, where there was one."""
        for items in reversed(self.spoken):
            noun = items[-1].words[-1]
            names = self.nouns.meant((*thing.words, noun), plural=True)
            if names:
                return Item((*thing.words, noun), names, thing.many == "all")
        names = self.nouns.fitting((*thing.words, "object"))
        if not names:
            raise self._not_there(f"{' '.join(thing.words)} one")
        return Item((*thing.words, "one"), names, thing.many == "all")

    def _again(self, which: str) -> Items:
        """Bodies that were mentioned before.

        Raises:
            PlanRejected: nothing was, or not what the word needs.
        """
        self.require_sure()
        if not self.spoken:
            if which == "all":
                return (self._everything(Everything()),)
            raise PlanRejected("'it' stands for nothing that was named; name the object")
        last = self.spoken[-1]
        names = [name for item in last for name in item.names]
        if which == "all" and len(names) < 2:
            return (self._everything(Everything()),)
        if which in ("former", "latter"):
            two = [item for items in self.spoken for item in items][-2:]
            return (two[0 if which == "former" else -1],)
        if which == "it" and len(last) > 1:
            raise PlanRejected(f"'it' may be {' or '.join(item.text for item in last)}; name one")
        return last

    def require_sure(self) -> None:
        """Require that no unread remark stands between a pronoun and its reference.

        Raises:
            PlanRejected: it was a side remark, and may be meant.
        """
        if self.unsure:
            raise PlanRejected("it is not clear what 'it' stands for here; name the object")

    def _everything(self, thing: Everything) -> Item:
        names = tuple(self.scene.bodies)
        if thing.others:
            self.require_sure()
            before = {name for item in self._before() for name in item.names}
            names = tuple(name for name in names if name not in before)
        return Item(("everything",), names, plural=True)

    def _chosen(self, thing: Chosen) -> Item:
        (item,) = self._items(thing.thing)
        if len(item.names) == 1:
            return item
        name, remark = farthest(thing.place, item.names, self.scene, item.text)
        return Item(item.words, (name,), remark=remark)

    def _placed(self, thing: Placed) -> Item:
        (item,) = tuple(self._items(thing.thing))
        marks = [mark for one in thing.marks for mark in self._marks(one)]
        anything = isinstance(thing.thing, Everything)
        names, remark = standing(thing.relation, item, marks, self.scene, anything)
        return Item(item.words, names, item.plural, remark or item.remark)

    def _marks(self, thing: Thing) -> Iterator[str]:
        """Landmarks of a relation; any of them may be meant.

        Raises:
            PlanRejected: it cannot be told.
        """
        for item in self._items(thing):
            if len(item.names) > 1 and not item.plural:
                raise PlanRejected(f"'the {item.text}' may be {_or(item.names)}; name one")
            yield from item.names

    def _top(self, thing: Top) -> Iterator[Item]:
        """A surface; the top of anything else is a part of it.

        Raises:
            PlanRejected: it is a part.
        """
        for item in self._items(thing.thing):
            if not all(name in self.scene.surfaces for name in item.names):
                raise PlanRejected(f"the top of '{item.text}' is a part of it; name the whole")
            yield item

    def _less(self, thing: But) -> Iterator[Item]:
        items = tuple(self._items(thing.thing))
        less: set[str] = set()
        for item in self._excepted(thing.less, items):
            if len(item.names) > 1 and not item.plural:
                raise PlanRejected(f"'the {item.text}' may be {_or(item.names)}; name one")
            less.update(item.names)
        single = {name for item in items if not item.plural for name in item.names}
        if not less.isdisjoint(single):
            raise PlanRejected(f"{_quoted(sorted(less & single))} is both wanted and not wanted")
        for item in items:
            kept = tuple(name for name in item.names if name not in less)
            if kept:
                yield replace(item, names=kept)

    def _excepted(self, thing: Thing, items: Items) -> Iterator[Item]:
        """Bodies that are excluded; "the red one" is one of the set."""
        self.spoken.append(items)
        found = tuple(self._items(thing))
        self.spoken.pop()
        self.spared += found
        yield from found

    def _not_there(self, words: str) -> InputError:
        listed = ", ".join(self.scene.bodies) or "no objects at all"
        return InputError(f"the scene has no '{words}'; it has {listed}")


def _quoted(names: Iterable[str]) -> str:
    return " and ".join(f"'{name}'" for name in names)


def _or(names: Iterable[str]) -> str:
    return " or ".join(f"'{name}'" for name in names)
