"""Meanings of the parts of a sentence, independent of the scene."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Named:
    """Things by a noun. `many`: their number, "one", "all", "any" or a figure. `told`: a relative
    clause, "which my aunt gave us"."""

    words: tuple[str, ...]
    many: str = "one"
    told: str = ""


@dataclass(frozen=True, slots=True)
class Absent:
    """A thing by a noun that fits nothing in the scene."""

    words: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Again:
    """Things said before: "it", "they", "former", "latter", "here"."""

    which: str


@dataclass(frozen=True, slots=True)
class Everything:
    """All objects; `others`: that were not spoken of before."""

    others: bool = False


@dataclass(frozen=True, slots=True)
class Coloured:
    """ "The red one"."""

    words: tuple[str, ...]
    many: str = "one"


@dataclass(frozen=True, slots=True)
class Chosen:
    """The one of several that is so: "the left box"."""

    place: str
    thing: Thing


@dataclass(frozen=True, slots=True)
class Placed:
    """Things selected by their position."""

    thing: Thing
    relation: str
    marks: tuple[Thing, ...]


@dataclass(frozen=True, slots=True)
class But:
    """Things less others."""

    thing: Thing
    less: Thing


@dataclass(frozen=True, slots=True)
class Several:
    """Things in a list."""

    things: tuple[Thing, ...]


@dataclass(frozen=True, slots=True)
class Choice:
    """Alternative of several things: "the mug or the bottle"."""

    things: tuple[Thing, ...]


@dataclass(frozen=True, slots=True)
class Top:
    """The top of a thing, which is no part of it where it is a surface."""

    thing: Thing


Thing = (
    Choice | Top | Named | Absent | Again | Everything | Coloured | Chosen | Placed | But | Several
)


@dataclass(frozen=True, slots=True)
class Quantity:
    """A quantity by its id, or a property that nothing measures by its name."""

    id: str
    word: str
    measurable: bool = True


@dataclass(frozen=True, slots=True)
class Pair:
    """Quantities of things. Without quantities: all that is missing. Without a thing: of what was
    spoken of, else of all that miss it; `every`: of all in any case."""

    quantities: tuple[Quantity, ...] = ()
    thing: Thing | None = None
    every: bool = False
    again: bool = False


@dataclass(frozen=True, slots=True)
class Say:
    """Intent of a clause and its pairs: "want", "know", "skip", or, relative to the clause before,
    "turn" (the opposite), "also" (the same), "about" (the complement)."""

    deed: str
    pairs: tuple[Pair, ...]


@dataclass(frozen=True, slots=True)
class Mention:
    """A clause that only names things. `alone`: it is nothing but their name."""

    thing: Thing
    alone: bool = False


@dataclass(frozen=True, slots=True)
class Simulated:
    """A deed that is to be simulated, by its verb, and with what."""

    verb: str
    thing: Thing | None = None


@dataclass(frozen=True, slots=True)
class Deed:
    """A deed that is asked for, and to what."""

    word: str
    things: tuple[Thing, ...]


@dataclass(frozen=True, slots=True)
class Handled:
    """A deed that a weighing does anyway."""

    word: str
    thing: Thing


@dataclass(frozen=True, slots=True)
class Unfelt:
    """A state that was asked about."""

    word: str


@dataclass(frozen=True, slots=True)
class Need:
    """ "What has to be measured?": after a purpose what that takes, else all that is missing."""


@dataclass(frozen=True, slots=True)
class It:
    """ "Measure it", after what is wanted."""


@dataclass(frozen=True, slots=True)
class Aside:
    """A side remark, which nobody looks into."""

    said: str


@dataclass(frozen=True, slots=True)
class Told:
    """Remark on the thing that was named last."""

    said: str


Act = Aside | Told | Say | Mention | Simulated | Deed | Handled | Unfelt | Need | It


@dataclass(frozen=True, slots=True)
class Marks:
    """Relation to other things, before the things are resolved."""

    relation: str
    marks: tuple[Thing, ...]
