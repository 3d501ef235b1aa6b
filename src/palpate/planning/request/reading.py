"""What has been understood of a request so far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from palpate.planning.request.clauses import Clause
from palpate.planning.request.item import Item
from palpate.planning.request.lexicon import PASSIVE, word_set
from palpate.planning.request.resolver import Resolver
from palpate.planning.request.wording import english

Objects = tuple[Item, ...]

_EVERYTHING = Item("everything", ("everything",))
_SIMULATING = ("simulat", "model", "twin")
_OF_FRAGMENTS = word_set("the a an this that these those my our both all each of 's")
_ASIDE = word_set("when if while before after how what which because since that where until")
"""Words before a deed that is told of and not asked for."""


@dataclass
class Reading:
    """What has been understood so far.

    Attributes:
        pairs: quantities that are wanted, with the objects they are said of.
        excluded: likewise what is not wanted; no quantity stands for all of them.
        alone: objects that are named without a quantity.
        spoken: the objects of every group so far, which "it" may mean.
        commands: deeds that the robot is asked to do.
        simulated: deeds that are to be simulated, and with what.
        wished: whether anything is said to be missing, or to be found out. at_large: whether that
            is said in a clause that names no object.
        fragment: whether nothing but objects is named so far.
    """

    resolver: Resolver
    pairs: list[tuple[Item, Objects]] = field(default_factory=list[tuple[Item, Objects]])
    excluded: list[tuple[Item | None, Objects]] = field(
        default_factory=list[tuple[Item | None, Objects]]
    )
    alone: list[Item] = field(default_factory=list[Item])
    spoken: list[Objects] = field(default_factory=list[Objects])
    commands: list[Item] = field(default_factory=list[Item])
    simulated: list[tuple[Item, Objects]] = field(default_factory=list[tuple[Item, Objects]])
    wished: bool = False
    at_large: bool = False
    fragment: bool = True

    def read(self, clause: Clause) -> None:
        """Take in the next clause: its quantities with their objects, then the other objects."""
        compares = clause.wanted and clause.compares
        used = self._read_comparison(clause) if compares else self._read_quantities(clause)
        measured = any(group.of_quantities for group in clause.groups)
        for at, group in enumerate(clause.groups):
            if at in used or group.of_quantities or (measured and not group.named):
                continue
            if clause.wanted:
                self.alone += clause.property_of_next(at) or group.named
            else:
                self.excluded.append((None, group.named or self._last_spoken()))
        if clause.wanted:
            named = [group for group in clause.groups if not group.of_quantities]
            self.fragment = self.fragment and len(named) <= 1
            self._read_wishes(clause)

    def aims(self) -> list[tuple[Item, Objects]]:
        """The quantities that have to be known for what is to be simulated."""
        found: list[tuple[Item, Objects]] = []
        for deed, objects in self.simulated:
            for id in english().purposes.get(deed.names[0], ()):
                found.append((Item("quantity", (id,), (id,)), objects))
        return found

    def set_aside(self) -> list[Item]:
        """What is named and says nothing of what is asked: objects besides, and those left out."""
        found = list(self.alone) if self.pairs else []
        for _, objects in self.excluded:
            found += objects
        return found

    def undone(self) -> list[Item]:
        """The deeds that were asked for beside a measurement and are no part of one."""
        return [deed for deed in self.commands if deed.names[0] not in english().handling]

    def _read_comparison(self, clause: Clause) -> set[int]:
        """Pair what is compared with all that it is compared of."""
        compared: list[Item] = []
        for group in clause.groups:
            if not group.of_quantities:
                compared += group.named or self._last_spoken()
        if not compared:
            compared += self._last_spoken() or (_EVERYTHING,)
        if clause.selects:
            compared = [replace(item, plural=True) for item in compared]
        for quantity in {item.names: item for item in clause.compares}.values():
            self.pairs.append((quantity, tuple(compared)))
        self._speak_of(tuple(compared))
        return set(range(len(clause.groups)))

    def _read_quantities(self, clause: Clause) -> set[int]:
        """Pair the quantities of a clause; the groups whose objects they are said of."""
        used: set[int] = set()
        for at, group in enumerate(clause.groups):
            if not group.of_quantities:
                self._speak_of(group.named)
                continue
            objects: Objects = ()
            if clause.said_of_next(at):
                objects = clause.groups[at + 1].named
                used.add(at + 1)
            for quantity in group.items:
                said_of = objects or self._meant(quantity)
                self._pair(quantity, said_of, clause.wanted)
                used |= _positions(said_of, clause, at)
        return used

    def _read_wishes(self, clause: Clause) -> None:
        """Whether it says that something is missing, and what it asks to be done or simulated."""
        simulating = False
        for at, item in enumerate(clause.items):
            if not english().wishes.isdisjoint(item.words):
                self.wished = True
                self.at_large = self.at_large or not clause.groups
            if item.kind in ("stop", "deed", "unmeasurable", "unknown"):
                self.fragment = self.fragment and item.text in _OF_FRAGMENTS
            simulating = simulating or item.text.startswith(_SIMULATING)
            if item.kind != "deed":
                continue
            if simulating:
                self.simulated.append((item, self._done_to(clause, at)))
            elif _is_command(clause.items[:at]):
                self.commands.append(item)

    def _done_to(self, clause: Clause, at: int) -> Objects:
        """What the deed at item `at` is done to: the objects right after it, "push the mug", else
        those before it, "the mug is pushed", "the mug slides off the table"."""
        passive = at > 0 and clause.items[at - 1].text in PASSIVE
        for group in clause.groups:
            if group.start < at or passive or group.of_quantities:
                continue
            between = clause.items[at + 1 : group.start]
            if not any(item.kind == "stop" and item.names for item in between):
                return group.named or self._last_spoken()
        before = [group.named for group in clause.groups if group.end < at and group.named]
        return before[-1] if before else self._last_spoken()

    def _pair(self, quantity: Item, objects: Objects, wanted: bool) -> None:
        if wanted:
            self.pairs.append((quantity, objects))
        else:
            self.excluded.append((quantity, objects))

    def _speak_of(self, objects: Objects) -> None:
        if objects:
            self.spoken.append(objects)

    def _meant(self, quantity: Item) -> Objects:
        """What was spoken of last that can have `quantity`: the meaning of "it", or of saying
        nothing."""
        for objects in reversed(self.spoken):
            if self.resolver.can_have(objects, quantity):
                return objects
        return ()

    def _last_spoken(self) -> Objects:
        return self.spoken[-1] if self.spoken else ()


def _positions(objects: Objects, clause: Clause, before: int) -> set[int]:
    """Which groups before group `before` name just these objects."""
    return {at for at, group in enumerate(clause.groups[:before]) if group.named == objects}


def _is_command(before: Sequence[Item]) -> bool:
    """Whether a deed after these items is asked for: "please put", "and then open"."""
    since = list(before)
    for i in range(len(before) - 1, -1, -1):
        if before[i].kind == "list":
            since = list(before[i + 1 :])
            break
    if any(item.text in _ASIDE for item in since):
        return False
    return all(item.kind in ("stop", "pronoun") for item in since)
