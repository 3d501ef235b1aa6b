"""Fate of a held object in a run that is stopped early."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Fate = Literal["put down", "held", "lost"]


@dataclass(frozen=True, slots=True)
class Held:
    """Object in the fingers as a run was stopped, and its fate.

    Attributes:
        object: its name; None for something that was just grasped.
        became: `put down` on a support that bears it; still `held`; or `lost`, out of the fingers by
            itself, so that nobody knows where it is.
    """

    object: str | None
    became: Fate

    @property
    def name(self) -> str:
        """Name for people."""
        return f"'{self.object}'" if self.object else "what was grasped"

    @property
    def warning(self) -> str | None:
        """Warning about it; None where it was put down."""
        if self.became == "held":
            return f"the fingers still hold {self.name}"
        if self.became == "lost":
            return (
                f"{self.name} was not put down and is not in the fingers any more: see where it is"
            )
        return None
