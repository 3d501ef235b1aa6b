"""Signals that ask a run to end.

A signal is raised where it comes, as `Interrupted`. Where something is under way that has to be
brought to an end first, such as a moving arm or a file that is being written, it is only noted, and
whoever is at work asks for it. One that finds the noted one before it unheard is raised all the
same: whatever hangs can be interrupted.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Generator, Iterable
from contextlib import contextmanager
from types import FrameType


class Interrupted(KeyboardInterrupt):
    """A signal came while nothing was under way that had to be brought to an end first."""


class Interrupts:
    """The signals that have come, and what becomes of the next one."""

    def __init__(self) -> None:
        self._count = 0
        self._heard = 0
        self._before = 0
        self._noting = 0
        self._latest = ""

    @property
    def count(self) -> int:
        """How many have come."""
        return self._count

    def __repr__(self) -> str:
        return f"<Interrupts: {self._count} so far>"

    def take(self, number: int, _frame: FrameType | None = None) -> None:
        """The handler of a signal.

        Raises:
            Interrupted: unless it is noted.
        """
        hurried = self._heard < self._count
        self._count += 1
        self._latest = signal.Signals(number).name
        if self._noting and not hurried:
            return
        self._heard = self._count
        raise Interrupted(self.reason)

    @contextmanager
    def noted(self) -> Generator[None]:
        """Signals are only noted inside the outermost of these blocks, and those inside it."""
        if not self._noting:
            self._before = self._count
        self._noting += 1
        try:
            yield
        finally:
            self._noting -= 1

    def pressed(self) -> int:
        """How many have come since signals are noted; they are heard now."""
        self._heard = self._count
        return self._count - self._before

    @property
    def reason(self) -> str:
        """The latest one in words."""
        return "interrupted" if self._latest in ("", "SIGINT") else f"interrupted by {self._latest}"


@contextmanager
def interrupts(signals: Iterable[signal.Signals] = (signal.SIGINT,)) -> Generator[Interrupts]:
    """Those that this process takes already, else new ones that take `signals` inside the block.

    Off the main thread, where Python takes none, nothing is taken.
    """
    taken = getattr(signal.getsignal(signal.SIGINT), "__self__", None)
    if isinstance(taken, Interrupts):
        yield taken
        return
    new = Interrupts()
    if threading.current_thread() is not threading.main_thread():
        yield new
        return
    previous = {number: signal.signal(number, new.take) for number in signals}
    try:
        yield new
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler or signal.SIG_DFL)


@contextmanager
def not_noted() -> Generator[None]:
    """What was only noted inside the block is raised at its end: nothing real had to be brought to
    an end.

    Raises:
        Interrupted: a signal came meanwhile.
    """
    with interrupts() as signals:
        before = signals.count
        yield
        if signals.count > before:
            raise Interrupted(signals.reason)
