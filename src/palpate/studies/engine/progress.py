"""Progress of a study: tasks done and time left."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

MINUTE, HOUR = 60.0, 3600.0


@dataclass(slots=True)
class Progress:
    """Counts what is done of `total`; `before` of it was done when it began."""

    total: int
    before: int = 0
    clock: Callable[[], float] = time.monotonic
    done: int = field(init=False)
    began: float = field(init=False)

    def __post_init__(self) -> None:
        self.done, self.began = self.before, self.clock()

    def step(self) -> str:
        """Count one more finished task; return the progress as a line of text."""
        self.done += 1
        return str(self)

    def __str__(self) -> str:
        so_far, elapsed = self.done - self.before, self.clock() - self.began
        if not so_far or elapsed <= 0.0:
            return f"{self.done}/{self.total}"
        each = elapsed / so_far
        line = f"{self.done}/{self.total} · {MINUTE / each:.3g} a minute"
        if self.done < self.total:
            line += f" · {_duration(each * (self.total - self.done))} left"
        return line


def _duration(seconds: float) -> str:
    """Format a duration: `42 s`, `17 min`, `3 h 05 min`."""
    if seconds < 2 * MINUTE:
        return f"{seconds:.0f} s"
    if seconds < 2 * HOUR:
        return f"{seconds / MINUTE:.0f} min"
    minutes = round(seconds / MINUTE)
    return f"{minutes // 60} h {minutes % 60:02d} min"
