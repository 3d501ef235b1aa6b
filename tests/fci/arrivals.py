"""Which of a client's commands arrived."""

from __future__ import annotations

from collections import deque

REMEMBERED = 100
"""Cycles that the success rate is told of."""


class Arrivals:
    """Of the last cycles of a motion.

    Attributes:
        missed: cycles in a row without a command, now. gap: the same just before the last one that
            arrived. rate: of success.
    """

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """A motion begins."""
        self._last: deque[bool] = deque([True] * REMEMBERED, REMEMBERED)
        self._arrived, self.missed, self.gap = REMEMBERED, 0, 0

    @property
    def rate(self) -> float:
        return self._arrived / REMEMBERED

    def note(self, arrived: bool) -> None:
        """One more cycle."""
        self._arrived += arrived - self._last[0]
        self._last.append(arrived)
        if arrived:
            self.gap, self.missed = self.missed, 0
        else:
            self.missed += 1
