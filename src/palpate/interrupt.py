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

from palpate.errors import ExecutionAborted


class Interrupted(KeyboardInterrupt):
    """A signal came while nothing was under way that had to be brought to an end first."""


class Interrupts:
    """The signals that have come, and what becomes of the next one."""

    def __init__(self) -> None:
        self._count = 0
        self._heard = 0
        self._before = 0
        self._noting = False
        self._latest = ""

    @property
    def count(self) -> int:
        """Number of signals so far."""
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
        """Signals are only noted inside the block."""
        noting, before = self._noting, self._before
        if not noting:
            self._before = self._count
        self._noting = True
        try:
            yield
        finally:
            self._noting, self._before = noting, before

    @contextmanager
    def raised(self) -> Generator[None]:
        """Signals are raised inside the block: at its beginning one that was noted and nobody has
        heard, at its end one that was noted inside it, or raised where Python ignores exceptions.

        Raises:
            Interrupted: a signal came.
        """
        noting, before, self._noting = self._noting, self._heard, False
        try:
            self._raise_beyond(before)
            yield
            self._raise_beyond(before)
        finally:
            self._noting = noting

    def _raise_beyond(self, before: int) -> None:
        if self._count > before:
            self._heard = self._count
            raise Interrupted(self.reason)

    def pressed(self) -> int:
        """Number of signals since they are noted; they count as handled now."""
        self._heard = self._count
        return self._count - self._before

    def forget(self) -> None:
        """Forget the signals so far: they only ended a wait after everything was done."""
        self._count = self._heard = self._before = 0

    @property
    def reason(self) -> str:
        """The latest one in words."""
        return "interrupted" if self._latest in ("", "SIGINT") else f"interrupted by {self._latest}"


@contextmanager
def interrupts(signals: Iterable[signal.Signals] = (signal.SIGINT,)) -> Generator[Interrupts]:
    """Signal handling of this process, if active, else a new one for `signals` inside the block.

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
def before_anything_moves(doing: str) -> Generator[None]:
    """A signal that comes inside the block is told as an `ExecutionAborted`.

    Args:
        doing: what is being done, in a word: `planning`.

    Raises:
        ExecutionAborted: a signal came.
    """
    try:
        with interrupts() as signals, signals.raised():
            yield
    except KeyboardInterrupt:
        raise ExecutionAborted(f"interrupted while {doing}; nothing has moved") from None


def ending_signals() -> tuple[signal.Signals, ...]:
    """Signals that ask a program to end; a hang-up unless it is ignored (nohup)."""
    hang_up = getattr(signal, "SIGHUP", None)
    if hang_up is None or signal.getsignal(hang_up) == signal.SIG_IGN:
        return (signal.SIGINT, signal.SIGTERM)
    return (signal.SIGINT, signal.SIGTERM, hang_up)


def ignore_signals() -> None:
    """Let a process that is ending already end."""
    for number in ending_signals():
        signal.signal(number, signal.SIG_IGN)
