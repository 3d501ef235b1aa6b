"""Work in a forked copy of this process."""

from __future__ import annotations

import math
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from functools import partial
from multiprocessing import parent_process
from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from multiprocessing.connection import Connection
    from multiprocessing.context import ForkProcess

K = TypeVar("K")
T = TypeVar("T")

GRACE = 2.0  # s in which a copy that is ended can remove what it wrote


class Beside(Generic[T]):
    """Result of `work`, computed by a forked copy of this process. A context manager; leaving it ends
    the copy.

    Without a copy, or if it fails, `result()` does the work in this process.
    """

    def __init__(self, work: Callable[[], T], copied: bool = True) -> None:
        """Begin the work; with `copied` False it waits for `result()`."""
        self._work = work
        self._copy: ForkProcess | None = None
        self._receiver: Connection | None = None
        self._results: list[T] = []
        if copied and can_copy():
            self._begin()

    @property
    def running(self) -> bool:
        """A copy is at work: it has not begun to send its result."""
        return self._receiver is not None and not self._results and not self._receiver.poll()

    def sent(self) -> T | None:
        """The result, if the copy has sent it already."""
        if self._receiver is not None and not self._results and self._receiver.poll():
            self._receive()
        return self._results[0] if self._results else None

    def result(self) -> T:
        """Wait for the result."""
        if not self._results:
            self._receive()
        return self._results[0] if self._results else self._work()

    def _receive(self) -> None:
        # A failed copy sends nothing: its error is raised again where the result is asked for.
        if self._receiver is not None:
            with suppress(EOFError, OSError):
                self._results.append(self._receiver.recv())

    def close(self) -> None:
        """End the copy."""
        if self._copy is not None and self._receiver is not None:
            self._copy.terminate()
            self._copy.join(GRACE)
            self._copy.kill()
            self._copy.join()
            self._receiver.close()
        self._copy = self._receiver = None

    def _begin(self) -> None:
        from multiprocessing import get_context

        context = get_context("fork")
        with suppress(OSError):  # no process to be had
            receiver, sender = context.Pipe(duplex=False)
            copy = context.Process(target=_work_and_send, args=(sender, self._work), daemon=True)
            with sender:
                copy.start()
            self._copy, self._receiver = copy, receiver

    def __enter__(self) -> Beside[T]:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def shared_out(work: Callable[[K], T], items: Sequence[K]) -> Iterator[T]:
    """Iterate over the results of `work` on each of `items`, in order: this process does the first of
    them, and for each further processor a copy does as many."""
    share = math.ceil(len(items) / processors())
    with ExitStack() as stack:
        copies = [
            stack.enter_context(Beside(partial(_each, work, items[first : first + share])))
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
    """Test that forking is safe and useful: a second processor, which no sibling of this process uses,
    and no other thread, whose locks the copy would wait for forever."""
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
    """End the copy through its `finally` blocks."""
    raise SystemExit
