"""Things of the scene, as a request names them."""

from __future__ import annotations

from dataclasses import dataclass

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
