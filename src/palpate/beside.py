"""Work that is done in a process of its own while this one does something else."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from multiprocessing.connection import Connection
    from multiprocessing.context import ForkProcess

T = TypeVar("T")


class Beside(Generic[T]):
    """Result of `work`, computed by a copy of this process. A context manager; an unused result is
    given up on exit.

    Where there can be no copy, or it has failed, the work is done here, when it is asked for.
    """

    def __init__(self, work: Callable[[], T]) -> None:
        """Begin."""
        self._work = work
        self._copy: ForkProcess | None = None
        self._told: Connection | None = None
        if can_copy():
            self._begin()

    def result(self) -> T:
        """Wait for it; ask once."""
        if self._told is not None:
            # A copy that failed says nothing: what is wrong is found again here.
            with suppress(EOFError, OSError):
                return self._told.recv()
        return self._work()

    def close(self) -> None:
        """Give it up."""
        if self._copy is not None and self._told is not None:
            self._copy.kill()
            self._copy.join()
            self._told.close()
        self._copy = self._told = None

    def _begin(self) -> None:
        from multiprocessing import get_context

        context = get_context("fork")
        self._told, telling = context.Pipe(duplex=False)
        self._copy = context.Process(target=_tell, args=(telling, self._work), daemon=True)
        self._copy.start()
        telling.close()

    def __enter__(self) -> Beside[T]:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def can_copy() -> bool:
    """True if a copy of this process runs beside it: there is a second processor, and no thread
    whose locks the copy would wait for in vain."""
    if sys.platform != "linux" or threading.active_count() > 1:
        return False
    return len(os.sched_getaffinity(0)) > 1


def _tell(telling: Connection, work: Callable[[], T]) -> None:
    """In the copy; a signal to end the run is for the original to hear."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(BaseException):
        telling.send(work())
