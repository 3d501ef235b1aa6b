"""A request in clauses: what is wanted and what is not, as groups of quantities and of objects.

The grammar is written down in `palpate.planning.request.grounding`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from palpate.planning.request import lexicon
from palpate.planning.request.item import GRIPPER, Item
from palpate.planning.request.lexicon import DETERMINERS, EVERY, word_set
from palpate.planning.request.wording import english

Mode = Literal["want", "know", "skip"]
"""What a stretch of the request says of its parameters: wanted, known already, not wanted."""

_PRECISION = word_set("within accurate accuracy precision precise tolerance error resolution")
"""Words beside an amount that is no value but how well one is to be known."""
_QUESTIONS = word_set("how what which whether if")
_ASKING = word_set("is are was were do does did has have can could will would")
"""Words that ask, where a clause begins with them."""
_ORDERS = word_set("weigh measure determine find")
_MENTIONS = ("quantity", "unmeasurable", "object", "unknown", "pronoun", "everything")
"""Kinds of items that make up groups; the others only tie them together."""
_BETWEEN_LISTED = DETERMINERS | EVERY | {"of", "for", "also", "how", "then", "finally", "next"}
_ARTICLES = DETERMINERS | EVERY | {"only", "just"}
_POSSESSIVE = ("'s",)


@dataclass(frozen=True, slots=True)
class Group:
    """Quantities, or objects, that are listed together, from item `start` to item `end` of their
    clause."""

    items: tuple[Item, ...]
    start: int
    end: int

    @property
    def of_quantities(self) -> bool:
        """Whether it lists quantities; else objects."""
        return self.items[0].of_quantity

    @property
    def named(self) -> tuple[Item, ...]:
        """Its items less the pronouns, which name nothing."""
        return tuple(item for item in self.items if item.kind != "pronoun")


@dataclass(frozen=True, slots=True)
class Clause:
    """A stretch of the request. `wanted`: it says what is asked for; else what is known or not
    wanted."""

    items: tuple[Item, ...]
    groups: tuple[Group, ...]
    wanted: bool

    @property
    def compares(self) -> tuple[Item, ...]:
        """Its quantities, where it compares things by them."""
        quantities = tuple(item for item in self.items if item.kind == "quantity")
        than = any(item.text == "than" for item in self.items)
        if than or any(item.compared for item in quantities):
            return quantities
        return ()

    @property
    def selects(self) -> bool:
        """Whether it asks which of several: "the heaviest", "which box", "what box is heavier"."""
        words = {word for item in self.items for word in item.words}
        if "which" in words or not words.isdisjoint(english().superlatives):
            return True
        pairs = zip(self.items, self.items[1:], strict=False)
        return any(item.text == "what" and after.kind == "object" for item, after in pairs)

    def between(self, at: int) -> tuple[Item, ...]:
        """What stands between group `at` and the next."""
        return self.items[self.groups[at].end + 1 : self.groups[at + 1].start]

    def said_of_next(self, at: int) -> bool:
        """Whether the quantities of group `at` are said of the objects after them."""
        if at + 1 >= len(self.groups) or self.groups[at + 1].of_quantities:
            return False
        between = self.between(at)
        if any(item.links or item.text == ":" for item in between):
            return True
        # "weigh the mug", but not "the mug mass the bottle …": there the mass is the mug's.
        return _only(between, _ARTICLES) and not self.said_of_previous(at)

    def said_of_previous(self, at: int) -> bool:
        """Whether an object stands right before the quantities of group `at`: "bottle mass", "the
        bottle's mass"."""
        if at == 0 or self.groups[at - 1].of_quantities:
            return False
        if self.groups[at - 1].items[-1].names == (GRIPPER,):
            return False
        return _only(self.between(at - 1), _POSSESSIVE)

    def property_of_next(self, at: int) -> tuple[Item, ...]:
        """In "the wetness of the bottle", an unknown word that is a property and not an object."""
        item = self.groups[at].items[0]
        if item.kind != "unknown" or at + 1 >= len(self.groups):
            return ()
        between = self.between(at)
        before_object = self.groups[at + 1].items[0].kind == "object"
        if before_object and between and between[0].text == "of":
            return (Item("unmeasurable", item.words, (item.text,)),)
        return ()


def clauses(items: Sequence[Item]) -> Iterator[Clause]:
    """The clauses of a request, in order; a turn of phrase ends one and begins another."""
    current: list[Item] = []
    mode: Mode = "want"
    for i, item in enumerate(items):
        turned = _turn(item, items[i + 1 :], mode, bool(current))
        if turned is None:
            current.append(item)
            continue
        if item.text == "§was_known":  # it says so of what stands before it
            mode = "know"
        yield _clause(current, mode)
        current, mode = [], turned
    yield _clause(current, mode)


def _turn(item: Item, following: Sequence[Item], mode: Mode, begun: bool) -> Mode | None:
    """The mode that begins at `item`, None when the present one goes on; `begun`: it has words."""
    if item.kind == "mark":
        return _marked(item, mode)
    if item.kind == "break" and item.text != ":":
        return "want"
    if mode == "know" and item.text in lexicon.TURNS:
        # "we know the height but not the mass": the negation itself is the turn
        negated = following and following[0].text == "§neg"
        return None if negated else "want"
    if mode == "skip" and item.text == "but":
        return "want"
    if mode == "skip" and item.text == "and" and begun:
        # "Skip the ball and weigh the rest", but not "do not lift and weigh the ball".
        return "want" if following and following[0].text in _ORDERS else None
    if mode == "skip" and item.text == ",":
        # "Not the bottle, the mug: how heavy is it?"
        introduced = any(later.text == ":" for later in following)
        return "want" if introduced or _begins_with_quantity(following) else None
    return None


def _marked(item: Item, mode: Mode) -> Mode:
    """The mode after a mark. What is not known is wanted: "we know … but not the mass"."""
    if item.text == "§know":
        return "know"
    if item.text == "§neg" and mode != "know":
        return "skip"
    return "want"


def _begins_with_quantity(items: Sequence[Item]) -> bool:
    for item in items:
        if item.kind not in ("stop", "list", "pronoun"):
            return item.of_quantity
    return False


def _clause(items: Sequence[Item], mode: Mode) -> Clause:
    said = _without_relative_where(items)
    wanted = mode == "want" and not _states_amount(said)
    together = Clause(said, _groups(said), wanted)
    return Clause(said, tuple(_apart(together)), wanted)


def _states_amount(items: Sequence[Item]) -> bool:
    """Whether it says how much something is: "the mug weighs 300 g"."""
    words = {item.text for item in items}
    if not any(item.kind == "amount" for item in items) or any(item.compared for item in items):
        return False
    asked = items[0].text in _ASKING or not words.isdisjoint(_QUESTIONS)
    return not asked and words.isdisjoint(_PRECISION)


def _without_relative_where(items: Sequence[Item]) -> tuple[Item, ...]:
    """The items without any "where" that asks for no position: a relative clause, "tell me where
    its balance point is"."""
    kept: list[Item] = []
    for i, item in enumerate(items):
        if item.text != "where" or _asks_where(items, i):
            kept.append(item)
    return tuple(kept)


def _asks_where(items: Sequence[Item], at: int) -> bool:
    if at > 0 and items[at - 1].text not in lexicon.BEFORE_WHERE:
        return False
    return not any(item.of_quantity for item in items[at + 1 :])


def _groups(items: Sequence[Item]) -> tuple[Group, ...]:
    """What is listed together: "the mass and the friction", "the bottle, the mug and the box"."""
    groups: list[Group] = []
    for i, item in enumerate(items):
        if item.kind not in _MENTIONS:
            continue
        last = groups[-1] if groups else None
        alike = last is not None and last.of_quantities == item.of_quantity
        if last and alike and _is_list(items[last.end + 1 : i]):
            groups[-1] = Group((*last.items, item), last.start, i)
        else:
            groups.append(Group((item,), i, i))
    return tuple(groups)


def _is_list(between: Sequence[Item]) -> bool:
    """Whether what stands between two mentions makes a list of them."""
    listed = False
    for item in between:
        if item.kind == "list":
            listed = True
        elif item.text not in _BETWEEN_LISTED:
            return False
    return listed


def _apart(clause: Clause) -> Iterator[Group]:
    """The clause's groups, those divided that only look like one list."""
    for at, group in enumerate(clause.groups):
        several = len(group.items) > 1
        if several and (_ends_with_owner(clause, at) or _ends_with_other_quantity(clause, at)):
            yield Group(group.items[:-1], group.start, _last_list_word(clause, group) - 1)
            yield Group(group.items[-1:], group.end, group.end)
        else:
            yield group


def _ends_with_owner(clause: Clause, at: int) -> bool:
    """In "the mass of the bottle and mug friction", the mug belongs to the friction."""
    if clause.groups[at].of_quantities or at == 0 or at + 1 >= len(clause.groups):
        return False
    return _only(clause.between(at), _POSSESSIVE) and not clause.said_of_next(at + 1)


def _ends_with_other_quantity(clause: Clause, at: int) -> bool:
    """In "what does the cup weigh and how high is the table", the weight belongs to the cup."""
    if not clause.groups[at].of_quantities:
        return False
    return clause.said_of_previous(at) and clause.said_of_next(at)


def _last_list_word(clause: Clause, group: Group) -> int:
    """Where the "and" or the comma before the group's last item stands."""
    at = group.end - 1
    while clause.items[at].kind != "list":
        at -= 1
    return at


def _only(items: Sequence[Item], words: Collection[str]) -> bool:
    """Whether there is nothing but `words`, if anything."""
    return all(item.text in words for item in items)
