"""What the parts of a sentence mean, before it is known what of it the scene has."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Named:
    """Things by a noun. `many`: how many are meant, "one", "all", "any", or the number.
    `told`: what was said of it beside, "which my aunt gave us"."""

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
    """Those of several that stand so."""

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
    """One of several, whichever: "the mug or the bottle"."""

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
    """What a clause does with its pairs: "want", "know", "skip", or, where only what came before
    tells, "turn" (the opposite), "also" (the same), "about" (whatever was not said)."""

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
    """What was told of the thing that was named last, and is no part of what is asked."""

    said: str


Act = Aside | Told | Say | Mention | Simulated | Deed | Handled | Unfelt | Need | It


@dataclass(frozen=True, slots=True)
class Marks:
    """How a thing stands, before it is known which."""

    relation: str
    marks: tuple[Thing, ...]
