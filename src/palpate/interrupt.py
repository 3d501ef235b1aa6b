"""Signals that ask a run to end.

A signal raises `Interrupted` where it arrives. While an arm moves or a file is written it is deferred: the
work in progress polls `pressed()` and stops in order. A second signal raises if the first is still
pending, so that a program that hangs can be interrupted.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Generator, Iterable
from contextlib import contextmanager
from types import FrameType

from palpate.errors import ExecutionAborted


class Interrupted(KeyboardInterrupt):
    """A signal arrived outside of a `deferred` block."""


class Interrupts:
    """Handler and counter of signals."""

    def __init__(self) -> None:
        self._count = 0
        self._handled = 0
        self._before = 0
        self._deferring = False
        self._latest = ""

    @property
    def count(self) -> int:
        """Number of signals so far."""
        return self._count

    def __repr__(self) -> str:
        return f"<Interrupts: {self._count} so far>"

    def take(self, number: int, _frame: FrameType | None = None) -> None:
        """Handle a signal.

        Raises:
            Interrupted: it is not deferred, or an earlier one is still pending.
        """
        pending = self._handled < self._count
        self._count += 1
        self._latest = signal.Signals(number).name
        if self._deferring and not pending:
            return
        self._handled = self._count
        raise Interrupted(self.reason)

    @contextmanager
    def deferred(self) -> Generator[None]:
        """Defer signals inside the block."""
        deferring, before = self._deferring, self._before
        if not deferring:
            self._before = self._count
        self._deferring = True
        try:
            yield
        finally:
            self._deferring, self._before = deferring, before

    @contextmanager
    def raised(self) -> Generator[None]:
        """Raise signals inside the block: a pending one at its beginning, and at its end one that was
        deferred inside it or raised where Python ignores exceptions.

        Raises:
            Interrupted: a signal arrived.
        """
        deferring, before, self._deferring = self._deferring, self._handled, False
        try:
            self._raise_beyond(before)
            yield
            self._raise_beyond(before)
        finally:
            self._deferring = deferring

    def _raise_beyond(self, before: int) -> None:
        if self._count > before:
            self._handled = self._count
            raise Interrupted(self.reason)

    def pressed(self) -> int:
        """Number of signals since the outermost `deferred` block began; they count as handled now."""
        self._handled = self._count
        return self._count - self._before

    def forget(self) -> None:
        """Forget the signals so far: they only ended a wait after everything was done."""
        self._count = self._handled = self._before = 0

    @property
    def reason(self) -> str:
        """The latest signal in words."""
        return "interrupted" if self._latest in ("", "SIGINT") else f"interrupted by {self._latest}"


@contextmanager
def interrupts(signals: Iterable[signal.Signals] = (signal.SIGINT,)) -> Generator[Interrupts]:
    """Yield the active signal handling of this process, else install one for `signals`.

    Outside the main thread Python delivers no signals, and nothing is installed.
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
    """Convert a signal inside the block to an `ExecutionAborted`.

    Args:
        doing: name of the work: `planning`.

    Raises:
        ExecutionAborted: a signal arrived.
    """
    try:
        with interrupts() as signals, signals.raised():
            yield
    except KeyboardInterrupt:
        raise ExecutionAborted(f"interrupted while {doing}; nothing has moved") from None


def ending_signals() -> tuple[signal.Signals, ...]:
    """Signals that ask a program to end; SIGHUP unless it is ignored (nohup)."""
    hang_up = getattr(signal, "SIGHUP", None)
    if hang_up is None or signal.getsignal(hang_up) == signal.SIG_IGN:
        return (signal.SIGINT, signal.SIGTERM)
    return (signal.SIGINT, signal.SIGTERM, hang_up)


def ignore_signals() -> None:
    """Ignore further signals in a process that is ending."""
    for number in ending_signals():
        signal.signal(number, signal.SIG_IGN)
