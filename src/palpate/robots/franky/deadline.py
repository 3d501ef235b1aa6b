"""Calls that may never return, brought to an end."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Late(Exception):
    """A call did not return in time. It goes on in a thread of its own; what it returns is lost."""


class Call(Generic[T]):
    """A call in a daemon thread: `franky`'s constructors have no time-out, and a mute host would
    hold them for ever."""

    def __init__(self, what: Callable[[], T], name: str) -> None:
        self._what, self._done = what, threading.Event()
        self._result: T | None = None
        self._error: BaseException | None = None
        threading.Thread(target=self._run, name=name, daemon=True).start()

    def result(self, seconds: float) -> T:
        """What it returned.

        Raises:
            Late: nothing within `seconds`. Whatever the call raised.
        """
        if not self._done.wait(seconds):
            raise Late(f"no answer within {seconds:.1f} s")
        if self._error is not None:
            raise self._error
        return self._result  # pyright: ignore[reportReturnType]

    def _run(self) -> None:
        try:
            self._result = self._what()
        except BaseException as error:
            self._error = error
        finally:
            self._done.set()
