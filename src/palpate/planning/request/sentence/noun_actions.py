"""What the rules of `words/grammar.txt` make of nouns and of what is said beside them: things."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping

from palpate.planning.request.item import GRIPPER
from palpate.planning.request.sentence.meaning import (
    Absent,
    Again,
    But,
    Choice,
    Chosen,
    Coloured,
    Everything,
    Marks,
    Named,
    Placed,
    Several,
    Thing,
    Top,
)

Words = tuple[str, ...]


def all_of(thing: Thing) -> Thing:
    """All of a choice, where it is compared or not wanted."""
    return Several(thing.things) if isinstance(thing, Choice) else thing


def _but(thing: Thing, less: Thing) -> But:
    return But(thing, all_of(less))


def several(*things: Thing) -> Thing:
    return things[0] if len(things) == 1 else Several(things)


def _choice(*things: Thing) -> Choice:
    return Choice(things)


def _named(many: str, words: Words) -> Named:
    return Named(words, many)


def _named_told(words: Words, told: str) -> Named:
    """ "The mug, which my aunt gave us,"."""
    return Named(words, told=told)


def _counted(number: str) -> Named:
    """ "Which of the five"."""
    return Named(("object",), number)


def _named_last(_: Words, words: Words) -> Named:
    """ "The body called duck"."""
    return Named(words)


def _named_other(words: Words) -> Named:
    return Named(words, "other")


def _gripper() -> Named:
    return Named((GRIPPER,))


def _coloured(many: str, words: Words) -> Coloured:
    return Coloured(words, many)


def _absent(words: Words, _: Thing | None = None) -> Absent:
    return Absent(words)


def _absent_of(_: Thing, words: Words) -> Absent:
    return Absent(words)


def _others() -> Everything:
    return Everything(others=True)


def _select(place: str, words: Words) -> Chosen:
    """ "The left box"."""
    return Chosen(place, Named(words, "all"))


def _select_last(words: Words, *places: str) -> Chosen:
    """ "The box on the left", "farthest to the left"."""
    return Chosen(places[-1], Named(words, "all"))


def _marks(relation: str, *marks: Thing) -> Marks:
    return Marks(relation, marks)


def _marks_between(words: Words) -> Marks:
    """ "Between the boxes"."""
    return Marks("between", (Named(words, "2"),))


def placed(thing: Thing, place: Marks) -> Placed:
    return Placed(thing, place.relation, place.marks)


def _whatever(place: Marks) -> Placed:
    return placed(Everything(), place)


def of_class(words: Words, place: Marks) -> Placed:
    """All of a kind that stand so."""
    return placed(Named(words, "all"), place)


def _but_all(less: Thing) -> But:
    return _but(Everything(), less)


OF_THINGS: Mapping[str, Callable[..., Hashable]] = {
    "several": several,
    "choice": _choice,
    "named": _named,
    "named_told": _named_told,
    "counted": _counted,
    "named_last": _named_last,
    "named_other": _named_other,
    "coloured": _coloured,
    "gripper": _gripper,
    "absent": _absent,
    "absent_of": _absent_of,
    "again": Again,
    "everything": Everything,
    "others": _others,
    "select": _select,
    "select_last": _select_last,
    "whatever": _whatever,
    "placed": placed,
    "class": of_class,
    "marks": _marks,
    "marks_between": _marks_between,
    "surface_of": Top,
    "but_all": _but_all,
    "but": _but,
}
