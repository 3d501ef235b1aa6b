"""One unknown: the thread through the program."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, order=True)
class Parameter:
    """One unknown: a quantity of a named object of the scene."""

    object: str
    quantity: str

    def __str__(self) -> str:
        return f"{self.object}.{self.quantity}"
