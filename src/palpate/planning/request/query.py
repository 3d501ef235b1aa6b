"""Queries of a request, and the scene items that it names."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from palpate.common.parameter import Parameter

GRIPPER = "gripper"
"""Subject of quantities of the empty hand."""


@dataclass(frozen=True, slots=True)
class Item:
    """Bodies of a mention.

    Attributes:
        words: words of the mention.
        names: candidate bodies; several if it is ambiguous or a plural.
        plural: the mention includes all of `names`.
        remark: interpretation, if it differs from the literal words.
    """

    words: tuple[str, ...]
    names: tuple[str, ...]
    plural: bool = False
    remark: str = ""

    @property
    def text(self) -> str:
        """Words of the mention as text."""
        return " ".join(self.words)


@dataclass(frozen=True, slots=True)
class Grounded:
    """Parameters of a request.

    Attributes:
        asked: the named parameters, including those that the scene states.
        cannot: one sentence for each request that no plan can measure.
        remarks: interpretations of implicit wishes.
    """

    asked: tuple[Parameter, ...]
    cannot: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()


# Queries: quantities of selected bodies, independent of the scene.


@dataclass(frozen=True, slots=True)
class NamedQuantity:
    """Quantity by its id, or an unmeasurable property by its name."""

    id: str
    word: str
    measurable: bool = True


AGAIN = NamedQuantity("", "that")
"""Quantity of the previous query: "that of the mug"."""


@dataclass(frozen=True, slots=True)
class All:
    """All bodies; with `others`, those not mentioned before."""

    others: bool = False


@dataclass(frozen=True, slots=True)
class Names:
    """Body by its noun: "the red box"; `bare` without a determiner."""

    words: tuple[str, ...]
    bare: bool = False


@dataclass(frozen=True, slots=True)
class Kind:
    """All bodies of a noun: "both boxes"; `count` is their stated number."""

    words: tuple[str, ...]
    count: str = ""


@dataclass(frozen=True, slots=True)
class Except:
    """Bodies without others."""

    base: Selector
    less: Selector


@dataclass(frozen=True, slots=True)
class Near:
    """Bodies by their position relative to others: "the box next to the mug"."""

    base: Selector
    relation: str
    marks: tuple[Selector, ...]


@dataclass(frozen=True, slots=True)
class Extreme:
    """Outermost body to one side, or the largest: "the left box"."""

    base: Kind
    place: str


@dataclass(frozen=True, slots=True)
class Again:
    """Bodies named before: "it", "they", "one" ("the red one").

    "all" selects all bodies if none was named.
    """

    which: Literal["it", "they", "all", "one"]
    words: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Several:
    """List of bodies; `choice` if joined by "or"."""

    parts: tuple[Selector, ...]
    choice: bool = False


Selector = All | Names | Kind | Except | Near | Extreme | Again | Several


@dataclass(frozen=True, slots=True)
class Query:
    """Quantity of selected bodies.

    Without a quantity: all missing parameters. Without a selector: the last named bodies, else all
    that miss the quantity. With `every`: all bodies in any case.
    """

    quantity: NamedQuantity | None = None
    selector: Selector | None = None
    every: bool = False


@dataclass(frozen=True, slots=True)
class Say:
    """Statement of a clause about its queries.

    "want" requests them; "know" and "skip" exclude them. "turn" inverts the previous clause.
    "about" repeats its quantity ("what about the mug?").
    """

    how: str
    queries: tuple[Query, ...]


@dataclass(frozen=True, slots=True)
class Mention:
    """Bodies that are only named; `alone` if nothing else is in their clause."""

    selector: Selector
    alone: bool = False


@dataclass(frozen=True, slots=True)
class NamedPurpose:
    """Action to be simulated, by its verb, with its bodies."""

    verb: str
    selector: Selector


@dataclass(frozen=True, slots=True)
class Need:
    """Vague wish ("make it simulation-ready"): all missing parameters, unless some are named."""


@dataclass(frozen=True, slots=True)
class Aside:
    """Sentence that is set aside."""

    said: str


Act = Say | Mention | NamedPurpose | Need | Aside
