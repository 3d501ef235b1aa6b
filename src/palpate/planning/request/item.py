"""Things of the scene, as a request names them, and what it asks for."""

from __future__ import annotations

from dataclasses import dataclass

from palpate.parameter import Parameter

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
