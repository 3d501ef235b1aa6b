"""What becomes of what the fingers hold when a run is stopped early."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Fate = Literal["put down", "held", "lost"]


@dataclass(frozen=True, slots=True)
class Held:
    """What the fingers held as a run was stopped, and what became of it.

    Attributes:
        object: its name; None for something that was just grasped.
        became: `put down` on a support that bears it; still `held`; or `lost`, out of the fingers by
            itself, so that nobody knows where it is.
    """

    object: str | None
    became: Fate

    @property
    def name(self) -> str:
        """As people read it."""
        return f"'{self.object}'" if self.object else "what was grasped"

    @property
    def warning(self) -> str | None:
        """What somebody has to see to, in words; None where it was put down."""
        if self.became == "held":
            return f"the fingers still hold {self.name}"
        if self.became == "lost":
            return (
                f"{self.name} was not put down and is not in the fingers any more: see where it is"
            )
        return None
