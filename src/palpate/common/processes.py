"""Threads of linear algebra, memory, signals that end a run, and forked workers."""

from __future__ import annotations

import ctypes
import math
import os
import signal
import sys
import threading
from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import Future, wait
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from multiprocessing import parent_process
from types import FrameType
from typing import TYPE_CHECKING, Generic, TypeVar

from threadpoolctl import threadpool_limits

from palpate.common.errors import ExecutionAborted

if TYPE_CHECKING:
    from multiprocessing.connection import Connection
    from multiprocessing.context import ForkProcess


@contextmanager
def single_threaded_blas() -> Generator[None]:
    """Limit BLAS to one thread while the block runs, and restore the caller's limit.

    The estimators' matrices are small: several threads block each other and take ten times the processor
    time.
    """
    with threadpool_limits(1, "blas"):
        yield


def release_memory() -> None:
    """Return freed memory to the operating system, where the C library can (glibc).

    Models and signals of a run leave gaps between blocks in use. They grow by 2 MB a run without this call.
    """
    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)


# Signals that ask a run to end.


class Interrupted(KeyboardInterrupt):
    """A signal arrived outside of a `defer` block."""


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
        """Handle a signal. Raises Interrupted: it is not deferred, or an earlier signal is still pending."""
        # A second signal while one is pending is raised at once.
        pending = self._handled < self._count
        self._count += 1
        self._latest = signal.Signals(number).name
        if self._deferring and not pending:
            return
        self._handled = self._count
        raise Interrupted(self.reason)

    @contextmanager
    def defer(self) -> Generator[None]:
        """Defer signals inside the block."""
        # Remember the count at the outermost block, and restore the state at its end.
        deferring, before = self._deferring, self._before
        if not deferring:
            self._before = self._count
        self._deferring = True
        try:
            yield
        finally:
            self._deferring, self._before = deferring, before

    @contextmanager
    def raise_in_block(self) -> Generator[None]:
        """Raise signals inside the block.

        A pending signal is raised at the beginning. At the end a signal is raised that was deferred inside
        the block, or raised where Python ignores exceptions. Raises Interrupted: a signal arrived.
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

    def count_new(self) -> int:
        """Return the number of signals since the outermost `defer` block began; they count as handled now."""
        self._handled = self._count
        return self._count - self._before

    def forget(self) -> None:
        """Forget the signals so far: they only ended a wait after all work was done."""
        self._count = self._handled = self._before = 0

    @property
    def reason(self) -> str:
        """The latest signal in words."""
        return "interrupted" if self._latest in ("", "SIGINT") else f"interrupted by {self._latest}"


@contextmanager
def interrupts(signals: Iterable[signal.Signals] = (signal.SIGINT,)) -> Generator[Interrupts]:
    """Yield the active signal handling of this process, or install one for `signals`.

    Outside the main thread Python delivers no signals, and nothing is installed.
    """
    # A nested call shares the active handler.
    taken = getattr(signal.getsignal(signal.SIGINT), "__self__", None)
    if isinstance(taken, Interrupts):
        yield taken
        return
    new = Interrupts()
    if threading.current_thread() is not threading.main_thread():
        yield new
        return
    # Install the handler, and restore the previous ones at the end.
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
        with interrupts() as signals, signals.raise_in_block():
            yield
    except KeyboardInterrupt:
        raise ExecutionAborted(f"interrupted while {doing}; nothing has moved") from None


def ending_signals() -> tuple[signal.Signals, ...]:
    """Return the signals that ask a program to end; SIGHUP unless it is ignored (nohup)."""
    hang_up = getattr(signal, "SIGHUP", None)
    if hang_up is None or signal.getsignal(hang_up) == signal.SIG_IGN:
        return (signal.SIGINT, signal.SIGTERM)
    return (signal.SIGINT, signal.SIGTERM, hang_up)


def ignore_signals() -> None:
    """Ignore further signals in a process that is ending."""
    for number in ending_signals():
        signal.signal(number, signal.SIG_IGN)


# Work in a forked copy of this process.

K = TypeVar("K")
T = TypeVar("T")

GRACE = 2.0  # s in which a terminated copy can remove its files


class Fork(Generic[T]):
    """Result of `work`, computed by a forked copy of this process. A context manager; leaving it ends the copy.

    Without a copy, or if it fails, `result()` does the work in this process.
    """

    def __init__(self, work: Callable[[], T], copied: bool = True) -> None:
        """Begin the work; with `copied` False, `result()` does it."""
        self._work = work
        self._copy: ForkProcess | None = None
        self._receiver: Connection | None = None
        self._results: list[T] = []
        if copied and can_copy():
            self._begin()

    @property
    def running(self) -> bool:
        """True while a copy works and has not begun to send its result."""
        return self._receiver is not None and not self._results and not self._receiver.poll()

    def sent(self) -> T | None:
        """Return the result if the copy has already sent it, else None."""
        if self._receiver is not None and not self._results and self._receiver.poll():
            self._receive()
        return self._results[0] if self._results else None

    def result(self, patience: float | None = None) -> T:
        """Wait for the result; a copy that needs more than `patience`, s, has failed."""
        if not self._results and self._receiver is not None and self._receiver.poll(patience):
            self._receive()
        return self._results[0] if self._results else self._work()

    def _receive(self) -> None:
        # A failed copy sends nothing: `result()` raises its error again in this process.
        assert self._receiver is not None
        with suppress(EOFError, OSError):
            self._results.append(self._receiver.recv())

    def close(self) -> None:
        """End the copy."""
        if self._copy is not None and self._receiver is not None:
            # Give the copy time to remove its files, then kill it.
            self._copy.terminate()
            self._copy.join(GRACE)
            self._copy.kill()
            self._copy.join()
            self._receiver.close()
        self._copy = self._receiver = None

    def _begin(self) -> None:
        from multiprocessing import get_context

        context = get_context("fork")
        with suppress(OSError):  # no process available
            receiver, sender = context.Pipe(duplex=False)
            copy = context.Process(target=_work_and_send, args=(sender, self._work), daemon=True)
            with sender:
                copy.start()
            self._copy, self._receiver = copy, receiver

    def __enter__(self) -> Fork[T]:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def shared_out(work: Callable[[K], T], items: Sequence[K]) -> Generator[T]:
    """Iterate over the results of `work` on each of `items`, in order.

    This process handles the first share of the items, and one copy per further processor handles an equal
    share.
    """
    # Divide the items into equal shares.
    share = math.ceil(len(items) / processors())
    with ExitStack() as stack:
        copies = [
            stack.enter_context(Fork(partial(_each, work, items[first : first + share])))
            for first in range(share, len(items), share or 1)
        ]
        for item in items[:share]:
            yield work(item)
        for copy in copies:
            yield from copy.result()


def _each(work: Callable[[K], T], items: Sequence[K]) -> list[T]:
    return [work(item) for item in items]


def processors() -> int:
    """Number of processors that this process and its copies may use."""
    return len(os.sched_getaffinity(0)) if can_copy() else 1


def can_copy() -> bool:
    """Test if forking is safe and useful.

    It needs a second processor that no sibling of this process uses. It also needs that no other thread
    runs, whose locks would block the copy for ever.
    """
    if sys.platform != "linux" or threading.active_count() > 1:
        return False
    return len(os.sched_getaffinity(0)) > 1 and parent_process() is None


def _work_and_send(sender: Connection, work: Callable[[], T]) -> None:
    """Do the work in the copy and send its result."""
    # Ctrl-C ends the run in the original process, which then ends the copy.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(BaseException):
        signal.signal(signal.SIGTERM, _leave)
        sender.send(work())


def _leave(*_: object) -> None:
    """End the copy by way of its `finally` blocks."""
    raise SystemExit


# Calls that may never return.


class CallTimeout(Exception):
    """A call did not return in time. It continues in its thread; its result is lost."""


class Call(Generic[T]):
    """A call in a daemon thread, for functions without a time-out that an unresponsive host would block for ever."""

    def __init__(self, what: Callable[[], T], name: str) -> None:
        self._future: Future[T] = Future()

        def run() -> None:
            try:
                self._future.set_result(what())
            except BaseException as error:
                self._future.set_exception(error)

        threading.Thread(target=run, name=name, daemon=True).start()

    def result(self, seconds: float) -> T:
        """Return the call's value, or raise its exception. Raises CallTimeout: no result within `seconds`."""
        if not wait([self._future], seconds).done:
            raise CallTimeout(f"no answer within {seconds:.1f} s")
        return self._future.result()
