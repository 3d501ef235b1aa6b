"""Meanings of the grammar's rules: the functions behind `=> action`, from the meanings of the parts."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import replace

from palpate.planning.request.sentence.meaning import (
    Absent,
    Act,
    Again,
    Aside,
    But,
    Choice,
    Chosen,
    Coloured,
    Deed,
    Everything,
    Handled,
    It,
    Marks,
    Mention,
    Named,
    Need,
    Pair,
    Placed,
    Quantity,
    Say,
    Several,
    Simulated,
    Thing,
    Told,
    Top,
    Unfelt,
)

Words = tuple[str, ...]


def all_of(thing: Thing) -> Thing:
    """All of a choice, where it is compared or not wanted."""
    return Several(thing.things) if isinstance(thing, Choice) else thing


def _but(thing: Thing, less: Thing) -> But:
    return But(thing, all_of(less))


def several(*things: Thing) -> Thing:
    return things[0] if len(things) == 1 else Several(things)


def _named(many: str, words: Words) -> Named:
    return Named(words, many)


def _named_told(words: Words, told: str) -> Named:
    """ "The mug, which my aunt gave us,"."""
    return Named(words, told=told)


def _choice(*things: Thing) -> Choice:
    return Choice(things)


def _absent(words: Words, _: Thing | None = None) -> Absent:
    return Absent(words)


def _counted(number: str) -> Named:
    """ "Which of the five"."""
    return Named(("object",), number)


def _coloured(many: str, words: Words) -> Coloured:
    return Coloured(words, many)


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
    "named": _named,
    "named_told": _named_told,
    "choice": _choice,
    "absent": _absent,
    "counted": _counted,
    "coloured": _coloured,
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


Part = Quantity | Thing | str
"""Argument of an action; a quantity also by its id."""


def _class_mention(words: Words, place: Marks) -> Mention:
    return Mention(of_class(words, place))


def _pair(*parts: Part) -> Pair:
    """Quantities and the thing that they are of, if any."""
    quantities = [part for part in parts if isinstance(part, Quantity)]
    quantities += [Quantity(part, part) for part in parts if isinstance(part, str)]
    things = [part for part in parts if not isinstance(part, (Quantity, str))]
    return Pair(tuple(dict.fromkeys(quantities)), things[0] if things else None)


def _unfelt_of(words: Words, thing: Thing) -> Pair:
    """A property that nothing measures, of a thing."""
    return Pair((Quantity(" ".join(words), words[-1], measurable=False),), thing)


def _listed(*parts: Part | Pair) -> tuple[Pair, ...]:
    """Quantities of one thing, and the pairs that are listed behind it."""
    behind = tuple(part for part in parts if isinstance(part, Pair))
    first = [part for part in parts if not isinstance(part, Pair)]
    return (_pair(*first), *behind)


def _every(*quantities: Quantity) -> Pair:
    return Pair(quantities, every=True)


def _that(thing: Thing) -> Pair:
    """ "That of the mug"."""
    return Pair((), thing, again=True)


def _how_large(asked: Quantity, pair: Pair) -> Pair:
    """ "How high is the friction?"; how high a centre of mass is, is asked of its third axis, too."""
    if not asked.measurable:
        return Pair((asked,), pair.thing)
    if asked.id == "height" and [quantity.id for quantity in pair.quantities] == ["com"]:
        return replace(pair, quantities=(replace(pair.quantities[0], id="com_3d"),))
    return pair


def _say(deed: str, *pairs: Pair) -> Say:
    """Quantities that no thing follows are of the thing of those behind them: "both the mass and the
    friction of the mug"."""
    said: list[Pair] = []
    thing: Thing | None = None
    for pair in reversed(pairs):
        thing = pair.thing or thing
        said.insert(
            0,
            pair if pair.every or not pair.quantities else replace(pair, thing=pair.thing or thing),
        )
    return Say(deed, tuple(said))


def _say_of(deed: str, *parts: Part) -> Say:
    if deed == "skip":
        parts = tuple(_each(part) for part in parts)
    return Say(deed, (_pair(*parts),))


def _each(part: Part) -> Part:
    return part if isinstance(part, (Quantity, str)) else all_of(part)


def _say_of_all(deed: str, *things: Thing) -> Say:
    return Say(deed, (Pair((), several(*things)),))


def _say_every(deed: str, *quantities: Quantity) -> Say:
    return Say(deed, (_every(*quantities),))


def _say_but(*parts: Act | Pair | Thing) -> tuple[Act, ...]:
    """Wishes, and exclusions from them."""
    said: list[Act] = []
    for part in parts:
        if isinstance(part, Pair):
            said.append(Say("skip", (part,)))
        elif isinstance(part, Act):
            said.append(part)
        else:
            said.append(Say("skip", (Pair((), part),)))
    return tuple(said)


def _unsaid(*parts: Act | Thing) -> tuple[Act, ...]:
    """Wishes, inverted to exclusions."""
    turned = [replace(part, deed="skip") if isinstance(part, Say) else part for part in parts]
    return _say_but(*turned)


def _repeated(deed: str, thing: Thing) -> Say:
    """ "Weigh the mug. What about the bottle?"."""
    return Say(deed, (_that(thing),))


def _mass() -> Quantity:
    return Quantity("mass", "mass")


def _inertial() -> tuple[Quantity, ...]:
    """The inertial parameters of a rigid body, as system identification calls them."""
    return tuple(Quantity(id, id) for id in ("mass", "com", "inertia"))


def _compared(*parts: Part) -> Say:
    """Quantity of everything that is compared."""
    things = [all_of(part) for part in parts if not isinstance(part, (Quantity, str))]
    thing = several(*things) if things else Again("all")
    return Say("want", (replace(_pair(*parts), thing=thing),))


def _selected(*parts: Part) -> Say:
    """Like `_compared`, for one of a class: all of the class, or those of it that are listed last."""
    quantities = [part for part in parts if isinstance(part, (Quantity, str))]
    things = [part for part in parts if not isinstance(part, (Quantity, str))]
    return _compared(*quantities, *things[-1:])


def _simulated(verb: str, *things: Thing) -> Simulated:
    return Simulated(verb, things[0] if things else None)


def _simulated_of(thing: Thing, verb: str) -> Simulated:
    return Simulated(verb, thing)


def _nothing(*_: Hashable) -> tuple[()]:
    return ()


def _marks_of(place: Marks) -> tuple[Thing, ...]:
    return place.marks


def _mention(thing: Thing, place: Marks | None = None) -> Mention:
    return Mention(thing if place is None else placed(thing, place))


def _told(thing: Thing, said: str) -> tuple[Act, ...]:
    """Something of a thing that is then asked about."""
    return Mention(thing, alone=True), Told(said)


def _told_of(said: str, thing: Thing) -> tuple[Act, ...]:
    """Remark on a thing, followed by a question about it."""
    return _told(thing, said)


def _alone(thing: Thing) -> Mention:
    return Mention(thing, alone=True)


def _deed(word: str, *things: Thing) -> Deed:
    return Deed(word, things)


def _unfelt(_: Thing, word: str) -> Unfelt:
    return Unfelt(word)


def _need(*_: Hashable) -> Need:
    return Need()


def _it(*_: Hashable) -> It:
    return It()


ACTIONS: Mapping[str, Callable[..., Hashable]] = {
    **OF_THINGS,
    "class_mention": _class_mention,
    "pair": _pair,
    "unfelt_of": _unfelt_of,
    "listed": _listed,
    "every": _every,
    "that": _that,
    "how_large": _how_large,
    "say": _say,
    "say_of": _say_of,
    "say_of_all": _say_of_all,
    "say_every": _say_every,
    "say_but": _say_but,
    "unsaid": _unsaid,
    "repeated": _repeated,
    "mass": _mass,
    "inertial": _inertial,
    "compared": _compared,
    "selected": _selected,
    "simulated": _simulated,
    "simulated_of": _simulated_of,
    "nothing": _nothing,
    "marks_of": _marks_of,
    "mention": _mention,
    "alone": _alone,
    "aside": Aside,
    "told": _told,
    "told_of": _told_of,
    "deed": _deed,
    "handled": Handled,
    "unfelt": _unfelt,
    "need": _need,
    "it": _it,
}
