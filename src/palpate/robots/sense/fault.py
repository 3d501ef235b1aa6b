"""Fault of a robot's signals."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Fault:
    """Reason to distrust the signals.

    Attributes:
        name: what people call it.
        what: one sentence, with figures.
        since: s, robot time: nothing that was sensed after it is evidence.
    """

    name: str
    what: str
    since: float

    def __str__(self) -> str:
        return f"{self.name} since {self.since:.2f} s: {self.what}"
