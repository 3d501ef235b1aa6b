"""Meanings of the grammar's rules: the functions behind `=> action`, from the meanings of the parts."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from functools import partial

from palpate.planning.request.nouns import OBJECT_NOUNS
from palpate.planning.request.sentence.query import (
    AGAIN,
    Again,
    All,
    Except,
    Extreme,
    Kind,
    Mention,
    Names,
    Near,
    Need,
    Purpose,
    Quantity,
    Query,
    Say,
    Selector,
    Several,
)

Words = tuple[str, ...]
Part = Quantity | Selector | str
"""A quantity, also by its id, or a selector."""


def _kind(*parts: str | Words) -> Kind:
    """All of a noun, behind their number, if it was said."""
    (words,) = (part for part in parts if not isinstance(part, str))
    return Kind(words, next((part for part in parts if isinstance(part, str)), ""))


def _extreme(*parts: str | Words) -> Extreme:
    """ "The left box", "the box farthest to the left"."""
    return Extreme(_kind(*(part for part in parts if not isinstance(part, str))), _last(parts))


def _last(parts: tuple[str | Words, ...]) -> str:
    return [part for part in parts if isinstance(part, str)][-1]


def _several(*parts: Selector) -> Selector:
    return parts[0] if len(parts) == 1 else Several(parts)


def _choice(*parts: Selector) -> Several:
    return Several(parts, choice=True)


def _all_of(selector: Selector) -> Selector:
    """All of a choice, where it is not wanted."""
    return Several(selector.parts) if isinstance(selector, Several) else selector


def _each(selector: Selector) -> Selector:
    """All of a kind, where one of it is looked for: "the heaviest box", "which box"."""
    match selector:
        case Names(words, bare) if bare or words[-1] in OBJECT_NOUNS:
            return Kind(words)
        case Near():
            return Near(_each(selector.base), selector.relation, selector.marks)
        case Several():
            return Several(tuple(map(_each, selector.parts)))
        case _:
            return selector


def _less(base: Selector, less: Selector) -> Except:
    return Except(base, _all_of(less))


def _marks(relation: str, *marks: Selector) -> tuple[Hashable, ...]:
    return relation, marks


def _near(base: Selector, relation: str, marks: tuple[Selector, ...]) -> Near:
    return Near(base, relation, marks)


def _top(base: Selector) -> Near:
    """ "The top of the table", which is no part of it; of anything but a surface it is."""
    return Near(base, "top", ())


def _quantities(parts: tuple[Part, ...]) -> tuple[Quantity, ...]:
    found = [Quantity(part, part) if isinstance(part, str) else part for part in parts]
    return tuple(dict.fromkeys(part for part in found if isinstance(part, Quantity)))


def _selectors(parts: tuple[Part, ...]) -> tuple[Selector, ...]:
    return tuple(part for part in parts if not isinstance(part, (Quantity, str)))


def _of(*parts: Part) -> tuple[Query, ...]:
    selector = next(iter(_selectors(parts)), None)
    return tuple(Query(quantity, selector) for quantity in _quantities(parts))


def _how_large(asked: Quantity, *parts: Part) -> tuple[Query, ...]:
    """ "How high is the friction"; of a centre of mass the third axis."""
    named = _quantities(parts)
    if asked.id == "height" and any(quantity.id == "com" for quantity in named):
        named = _quantities(("com_3d",))
    return _of(*(named or (asked,)), *_selectors(parts))


def _every(*quantities: Quantity) -> tuple[Query, ...]:
    return tuple(Query(quantity, every=True) for quantity in quantities)


def _that(selector: Selector) -> Query:
    return Query(AGAIN, selector)


def _say(how: str, *parts: Query | Quantity) -> Say:
    """Quantities that no thing follows are of the thing of those behind them: "neither the mass nor
    the friction of the mug"."""
    queries: list[Query] = []
    selector: Selector | None = None
    for part in reversed(parts):
        queries.insert(0, Query(part, selector) if isinstance(part, Quantity) else part)
        selector = queries[0].selector
    return Say(how, tuple(queries))


def _repeat(how: str, *selectors: Selector) -> Say:
    return Say(how, tuple(map(_that, selectors)))


def _exclude(*selectors: Selector) -> Say:
    return Say("skip", tuple(Query(None, _all_of(selector)) for selector in selectors))


def _no(*quantities: Quantity) -> Say:
    return Say("skip", _every(*quantities))


def _known(*parts: Part) -> Say:
    return Say("know", _of(*parts))


def _missing(selector: Selector | None = None) -> Say:
    return Say("want", (Query(None, selector),))


def _compared(*parts: Part) -> Say:
    """The quantity of everything that is compared; of all, if nothing is named."""
    selectors = tuple(map(_each, _selectors(parts))) or (Again("all"),)
    return Say("want", _of(*_quantities(parts)[:1], _several(*selectors)))


def _purpose(*parts: str | Selector) -> Purpose:
    (selector,) = (part for part in parts if not isinstance(part, str))
    return Purpose(next(part for part in parts if isinstance(part, str)), selector)


def _need(*_: Hashable) -> Need:
    return Need()


def _nothing(*_: Hashable) -> tuple[()]:
    return ()


ACTIONS: Mapping[str, Callable[..., Hashable]] = {
    "names": Names,
    "name": partial(Names, bare=True),
    "kind": _kind,
    "number": partial(Kind, ("object",)),
    "one": partial(Again, "one"),
    "extreme": _extreme,
    "again": Again,
    "all": All,
    "others": partial(All, others=True),
    "several": _several,
    "choice": _choice,
    "less": _less,
    "all_less": partial(_less, All()),
    "marks": _marks,
    "near": _near,
    "near_any": partial(_near, All()),
    "top": _top,
    "of": _of,
    "how_large": _how_large,
    "how_high": partial(_how_large, Quantity("height", "high")),
    "its": partial(_of, Again("it")),
    "that": _that,
    "every": _every,
    "mass": partial(Quantity, "mass", "mass"),
    "inertial": partial(_quantities, ("mass", "com", "inertia")),
    "missing": _missing,
    "say": _say,
    "about": partial(_repeat, "about"),
    "also": partial(_repeat, "also"),
    "exclude": _exclude,
    "no": _no,
    "known": _known,
    "compared": _compared,
    "mention": Mention,
    "alone": partial(Mention, alone=True),
    "purpose": _purpose,
    "need": _need,
    "nothing": _nothing,
}
