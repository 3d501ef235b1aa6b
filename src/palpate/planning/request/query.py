"""Queries of a request, and the items of the scene that it names."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from palpate.common.parameter import Parameter

GRIPPER = "gripper"
"""The subject of quantities that the empty hand itself has."""


@dataclass(frozen=True, slots=True)
class Item:
    """Bodies that a mention refers to.

    Attributes:
        words: what was said.
        names: which they may be, several when it is ambiguous or a plural.
        plural: all of `names` are meant.
        remark: how it was read, where that is not quite what was said.
    """

    words: tuple[str, ...]
    names: tuple[str, ...]
    plural: bool = False
    remark: str = ""

    @property
    def text(self) -> str:
        """Words of the mention."""
        return " ".join(self.words)


@dataclass(frozen=True, slots=True)
class Grounded:
    """Parameters that a request asks for.

    Attributes:
        asked: the parameters it names, whether or not the scene states them.
        cannot: one sentence for each thing asked that no plan can measure.
        remarks: how something unsaid was read.
    """

    asked: tuple[Parameter, ...]
    cannot: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()


# Queries of a request: quantities of selected bodies, independent of the scene.


@dataclass(frozen=True, slots=True)
class NamedQuantity:
    """A quantity by its id, or a property that nothing measures by its name."""

    id: str
    word: str
    measurable: bool = True


AGAIN = NamedQuantity("", "that")
"""The quantity of the query before: "that of the mug"."""


@dataclass(frozen=True, slots=True)
class All:
    """All bodies; `others`: those that were not spoken of before."""

    others: bool = False


@dataclass(frozen=True, slots=True)
class Names:
    """A body by its noun: "the red box". `bare`: without a determiner."""

    words: tuple[str, ...]
    bare: bool = False


@dataclass(frozen=True, slots=True)
class Kind:
    """All bodies of a noun: "both boxes". `count`: how many, if that was said."""

    words: tuple[str, ...]
    count: str = ""


@dataclass(frozen=True, slots=True)
class Except:
    """Bodies less others."""

    base: Selector
    less: Selector


@dataclass(frozen=True, slots=True)
class Near:
    """Bodies by their position relative to others: "the box beside the mug"."""

    base: Selector
    relation: str
    marks: tuple[Selector, ...]


@dataclass(frozen=True, slots=True)
class Extreme:
    """The body of several that is farthest to one side, or the largest: "the left box"."""

    base: Kind
    place: str


@dataclass(frozen=True, slots=True)
class Again:
    """Bodies that were named before: "it", "they", "one" ("the red one"); "all": everything, if nothing was."""

    which: Literal["it", "they", "all", "one"]
    words: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Several:
    """Bodies in a list; `choice`: joined by "or"."""

    parts: tuple[Selector, ...]
    choice: bool = False


Selector = All | Names | Kind | Except | Near | Extreme | Again | Several


@dataclass(frozen=True, slots=True)
class Query:
    """A quantity of selected bodies. Without a quantity: all that is missing. Without a selector: of
    what was named last, else of all that miss it; `every`: of all in any case."""

    quantity: NamedQuantity | None = None
    selector: Selector | None = None
    every: bool = False


@dataclass(frozen=True, slots=True)
class Say:
    """What a clause says of its queries: "want", "know" and "skip" exclude them, "turn" inverts the
    clause before, "about" repeats its quantity ("what about the mug?")."""

    how: str
    queries: tuple[Query, ...]


@dataclass(frozen=True, slots=True)
class Mention:
    """Bodies that are only named. `alone`: with nothing else in their clause."""

    selector: Selector
    alone: bool = False


@dataclass(frozen=True, slots=True)
class NamedPurpose:
    """An action that is to be simulated, by its verb, and with what."""

    verb: str
    selector: Selector


@dataclass(frozen=True, slots=True)
class Need:
    """A vague wish ("make it simulation-ready", "what is needed for that"): what is missing, unless
    something is named."""


@dataclass(frozen=True, slots=True)
class Aside:
    """A sentence that is set aside."""

    said: str


Act = Say | Mention | NamedPurpose | Need | Aside
