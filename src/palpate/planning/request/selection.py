"""Bodies of the scene that the selectors of a request refer to."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from palpate.errors import InputError, PlanRejected
from palpate.planning.request.item import GRIPPER, Item
from palpate.planning.request.nouns import OBJECT_NOUNS, Nouns
from palpate.planning.request.sentence.query import (
    Again,
    All,
    Except,
    Extreme,
    Kind,
    Names,
    Near,
    Selector,
    Several,
)
from palpate.planning.request.whereabouts import farthest, standing
from palpate.scene.scene import Scene

Items = tuple[Item, ...]


@dataclass
class Selection:
    """Resolver of selectors, with the history of mentions.

    Attributes:
        spoken: the bodies of every list so far, which "it" may mean.
        spared: those that were not wanted.
        remarks: how selectors were read that were not quite said so.
        unsure: whether something was set aside since, which "it" may mean, too.
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
            InputError: the scene has no such body. PlanRejected: it cannot be told which it is.
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
                yield self._named(selector.words)
            case Kind():
                yield self._kind(selector)
            case Except():
                yield from self._less(selector)
            case Near():
                yield self._placed(selector)
            case Extreme():
                yield self._farthest(selector)
            case Again(which="one"):
                yield self._one(selector.words)
            case Again():
                yield from self._again(selector.which)
            case Several(choice=True):
                raise PlanRejected("'or' leaves it open which is meant; say 'and', or name one")
            case Several():
                for one in selector.parts:
                    yield from self.found(one)

    def _everything(self, others: bool) -> Item:
        names = tuple(self.scene.bodies)
        if others:
            self.require_sure()
            before = {
                name for items in [*self.spoken, self.spared] for i in items for name in i.names
            }
            names = tuple(name for name in names if name not in before)
        return Item(("everything",), names, plural=True)

    def _named(self, words: tuple[str, ...]) -> Item:
        names = (GRIPPER,) if GRIPPER in words else self.nouns.meant(words, plural=False)
        if not names:
            raise self._not_there(" ".join(words))
        if len(names) > 1 and len(words) == 1 and words[0] in OBJECT_NOUNS:
            names = self._last(names)
        remark = f"'{' '.join(words)}' is taken for {_quoted(names)}."
        return Item(words, names, remark=remark if self.nouns.otherwise(words) else "")

    def _last(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """ "That thing": the one that was spoken of last."""
        if not self.spoken or self.unsure or len(self.spoken[-1]) > 1:
            return names
        return tuple(name for item in self.spoken[-1] for name in item.names)

    def _kind(self, kind: Kind) -> Item:
        said, names = " ".join(kind.words), self.nouns.meant(kind.words, plural=True)
        if not names:
            raise self._not_there(said)
        if kind.count and len(names) != int(kind.count):
            raise PlanRejected(
                f"the scene has {len(names)} of '{said}', not {kind.count}: {', '.join(names)}; name "
                "those that are meant"
            )
        taken = self.nouns.otherwise(kind.words) or self.nouns.is_kind(kind.words[-1])
        remark = f"'{said}' are taken to be {_quoted(names)}." if taken else ""
        return Item(kind.words, names, True, remark)

    def _one(self, words: tuple[str, ...]) -> Item:
        """ "The red one": of the kind spoken of, if there was one."""
        for items in reversed(self.spoken):
            said = (*words, items[-1].words[-1])
            names = self.nouns.meant(said, plural=True)
            if names:
                return Item(said, names)
        names = self.nouns.fitting((*words, "object"))
        if not names:
            raise self._not_there(f"{' '.join(words)} one")
        return Item((*words, "one"), names)

    def _again(self, which: str) -> Items:
        """Bodies that were named before."""
        self.require_sure()
        if not self.spoken:
            if which == "all":
                return (self._everything(others=False),)
            raise PlanRejected("'it' stands for nothing that was named; name the object")
        last = self.spoken[-1]
        if which == "all" and len([name for item in last for name in item.names]) < 2:
            return (self._everything(others=False),)
        if which == "it" and len(last) > 1:
            raise PlanRejected(f"'it' may be {' or '.join(item.text for item in last)}; name one")
        return last

    def require_sure(self) -> None:
        """Require that nothing was set aside between a pronoun and its reference.

        Raises:
            PlanRejected: something was, and may be meant.
        """
        if self.unsure:
            raise PlanRejected("it is not clear what 'it' stands for here; name the object")

    def _farthest(self, extreme: Extreme) -> Item:
        item = self._kind(extreme.base)
        if len(item.names) == 1:
            return replace(item, plural=False)
        name, remark = farthest(extreme.place, item.names, self.scene, item.text)
        return Item(item.words, (name,), remark=remark)

    def _placed(self, near: Near) -> Item:
        (item,) = self._items(near.base)
        if near.relation == "top":
            if self.scene.surfaces.keys().isdisjoint(item.names):
                raise PlanRejected(f"the top of '{item.text}' is a part of it; name the whole")
            return item
        marks = [name for mark in near.marks for name in self._each(mark)]
        anything = isinstance(near.base, All)
        names, remark = standing(near.relation, item, marks, self.scene, anything)
        return Item(item.words, names, item.plural, remark or item.remark)

    def _each(self, selector: Selector) -> Iterator[str]:
        """Names of the bodies of a selector."""
        for item in self._items(selector):
            if len(item.names) > 1 and not item.plural:
                choices = " or ".join(f"'{name}'" for name in item.names)
                raise PlanRejected(f"'the {item.text}' may be {choices}; name one")
            yield from item.names

    def _less(self, selector: Except) -> Iterator[Item]:
        items = tuple(self._items(selector.base))
        self.spoken.append(items)  # "the red one" is one of them
        less = set(self._each(selector.less))
        self.spoken.pop()
        self.spared.append(Item((), tuple(less), plural=True))
        single = {name for item in items if not item.plural for name in item.names}
        if not less.isdisjoint(single):
            raise PlanRejected(f"{_quoted(sorted(less & single))} is both wanted and not wanted")
        for item in items:
            kept = tuple(name for name in item.names if name not in less)
            if kept:
                yield replace(item, names=kept)

    def _not_there(self, words: str) -> InputError:
        listed = ", ".join(self.scene.bodies) or "no objects at all"
        why = self.scene.resolved.description.why_no_body(words)
        return InputError(f"the scene has no '{words}'; it has {listed}{why and '. ' + why}")


def _quoted(names: Iterable[str] | Sequence[str]) -> str:
    return " and ".join(f"'{name}'" for name in names)
