"""What the rules of `words/grammar.txt` make of the meanings of their parts.

Every action there is one of `ACTIONS`; it gets its own arguments and then the meanings, in order.
One that makes several at once returns them as a tuple.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import replace

from palpate.planning.request.sentence.meaning import (
    Act,
    Again,
    Aside,
    Deed,
    Everything,
    Handled,
    It,
    Marks,
    Mention,
    Need,
    Pair,
    Quantity,
    Say,
    Simulated,
    Thing,
    Told,
    Unfelt,
)
from palpate.planning.request.sentence.noun_actions import (
    OF_THINGS,
    Words,
    all_of,
    of_class,
    placed,
    several,
)

Part = Quantity | Thing | str
"""What actions get; a quantity also by its id."""


def _do_others() -> Say:
    return Say("want", (Pair((), Everything(others=True)),))


def _class_mention(words: Words, place: Marks) -> Mention:
    return Mention(of_class(words, place))


def _class_near(words: Words, place: str, mark: Thing) -> Mention:
    """ "Which can is closer to the drill?"."""
    relation = "nearest" if place == "near" else place
    return Mention(of_class(words, Marks(relation, (mark,))))


def _pair(*parts: Part) -> Pair:
    """Quantities and the thing that they are of, if any."""
    quantities = [part for part in parts if isinstance(part, Quantity)]
    quantities += [Quantity(part, part) for part in parts if isinstance(part, str)]
    things = [part for part in parts if not isinstance(part, (Quantity, str))]
    return Pair(tuple(dict.fromkeys(quantities)), things[0] if things else None)


def _unfelt_of(words: Words, thing: Thing) -> Pair:
    """A property that nobody knows."""
    return Pair((Quantity(" ".join(words), words[-1], measurable=False),), thing)


def _listed(*parts: Part | Pair) -> tuple[Pair, ...]:
    """Quantities of one thing, and what is listed behind."""
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


def _say_model(deed: str, thing: Thing) -> Say:
    """A model of a thing is one of all that stands on it."""
    return Say(deed, (Pair((), thing, every=True),))


def _say_every(deed: str, *quantities: Quantity) -> Say:
    return Say(deed, (_every(*quantities),))


def _say_but(*parts: Act | Pair | Thing) -> tuple[Act, ...]:
    """What is wanted, and of that what is not."""
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
    """What is said, as not wanted."""
    turned = [replace(part, deed="skip") if isinstance(part, Say) else part for part in parts]
    return _say_but(*turned)


def _same(thing: Thing) -> Say:
    """ "Do the same for the mug"."""
    return Say("want", (_that(thing),))


def _repeated(deed: str, thing: Thing) -> Say:
    """ "Weigh the mug. What about the bottle?"."""
    return Say(deed, (_that(thing),))


def _mass() -> Quantity:
    return Quantity("mass", "mass")


def _inertial() -> tuple[Quantity, ...]:
    """The inertial parameters of a rigid body, as system identification calls them."""
    return tuple(Quantity(id, id) for id in ("mass", "com", "inertia"))


def _compared(*parts: Part) -> Say:
    """What is compared, of all that it is compared of."""
    things = [all_of(part) for part in parts if not isinstance(part, (Quantity, str))]
    thing = several(*things) if things else Again("all")
    return Say("want", (replace(_pair(*parts), thing=thing),))


def _selected(*parts: Part) -> Say:
    """Like `_compared`, where one of a class is asked for: all of it are meant, or of the class
    those that are listed last."""
    quantities = [part for part in parts if isinstance(part, (Quantity, str))]
    things = [part for part in parts if not isinstance(part, (Quantity, str))]
    return _compared(*quantities, *things[-1:])


def _selected_among(thing: Thing, *parts: Part) -> Say:
    """ "Is the wrench the lightest tool?"."""
    return _selected(*parts) if len(parts) > 1 else _selected_all(thing, *parts)


def _selected_all(thing: Thing, *quantities: Part) -> Say:
    """ "Is the wrench lighter than all others?"."""
    return _compared(*quantities, Everything())


def _simulated(verb: str, *things: Thing) -> Simulated:
    return Simulated(verb, things[0] if things else None)


def _simulated_by(_: Words, verb: str, *things: Thing) -> Simulated:
    """ "A child pushing the cube": whoever does it is no matter of the thing."""
    return _simulated(verb, *things)


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
    """What somebody did with a thing that is then asked about."""
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
    "do_others": _do_others,
    "class_mention": _class_mention,
    "class_near": _class_near,
    "marks_of": _marks_of,
    "pair": _pair,
    "unfelt_of": _unfelt_of,
    "listed": _listed,
    "every": _every,
    "that": _that,
    "how_large": _how_large,
    "say": _say,
    "say_of": _say_of,
    "say_of_all": _say_of_all,
    "say_model": _say_model,
    "say_every": _say_every,
    "say_but": _say_but,
    "unsaid": _unsaid,
    "same": _same,
    "repeated": _repeated,
    "mass": _mass,
    "inertial": _inertial,
    "compared": _compared,
    "selected": _selected,
    "selected_among": _selected_among,
    "selected_all": _selected_all,
    "simulated": _simulated,
    "simulated_by": _simulated_by,
    "simulated_of": _simulated_of,
    "nothing": _nothing,
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
