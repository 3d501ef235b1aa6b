"""The library `franky`: loaded when it is used, and called with time limits."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import cache
from types import ModuleType
from typing import Generic, TypeVar

from palpate.errors import Unavailable

T = TypeVar("T")


@cache
def franky() -> ModuleType:
    """Load the module.

    Raises:
        Unavailable: it is not installed, or does not load.
    """
    try:
        import franky as module  # pyright: ignore[reportMissingTypeStubs]
    except ImportError as error:
        raise Unavailable(
            "the driver for a Franka is not installed: pip install 'palpate[franky]' (Linux on "
            f"x86_64): {error}"
        ) from error
    return module


class Late(Exception):
    """A call did not return in time. It continues in its thread; its result is lost."""


class Call(Generic[T]):
    """A call in a daemon thread: `franky`'s constructors have no time-out, and a mute host would
    block them for ever."""

    def __init__(self, what: Callable[[], T], name: str) -> None:
        self._what, self._done = what, threading.Event()
        self._result: T | None = None
        self._error: BaseException | None = None
        threading.Thread(target=self._run, name=name, daemon=True).start()

    def result(self, seconds: float) -> T:
        """Return the call's value, or raise what it raised.

        Raises:
            Late: no result within `seconds`.
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
