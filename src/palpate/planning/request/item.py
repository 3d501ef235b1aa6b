"""A stretch of a request, and what it may stand for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from palpate.planning.request import lexicon

Kind = Literal[
    "quantity",
    "unmeasurable",
    "object",
    "unknown",
    "pronoun",
    "everything",
    "deed",
    "selector",
    "filler",
    "aside",
    "amount",
    "mark",
    "stop",
    "break",
    "list",
    "word",
]

GRIPPER = "gripper"
"""The subject of quantities that the empty hand itself has."""


@dataclass(frozen=True, slots=True)
class Item:
    """A stretch of the request.

    Attributes:
        words: the stretch itself.
        names: what it may stand for: quantity ids, bodies (several when it is ambiguous or a
            plural), a relation, or a place by which one of several is chosen.
        plural: it means all of `names`.
        fitting: all bodies that its words fit, also those that its exact name rules out.
        compared: it compares things: "heavier", "the same weight".
        remark: how it was read, where that is not quite what was said.
    """

    kind: Kind
    words: tuple[str, ...]
    names: tuple[str, ...] = ()
    plural: bool = False
    fitting: tuple[str, ...] = ()
    compared: bool = False
    remark: str = ""

    @property
    def text(self) -> str:
        """The stretch as it was said."""
        return " ".join(self.words)

    @property
    def links(self) -> bool:
        """Whether this word ties a quantity to the object after it."""
        return self.kind == "stop" and self.words[0] in lexicon.LINKS

    @property
    def of_quantity(self) -> bool:
        """Whether it names a property, measurable or not."""
        return self.kind in ("quantity", "unmeasurable")


EDGE = Item("break", ("",))
"""What stands before the first item and after the last."""
