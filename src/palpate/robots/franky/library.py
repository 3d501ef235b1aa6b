"""The library `franky`: loaded when it is used, and called with time limits."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future, wait
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
        self._future: Future[T] = Future()

        def run() -> None:
            try:
                self._future.set_result(what())
            except BaseException as error:
                self._future.set_exception(error)

        threading.Thread(target=run, name=name, daemon=True).start()

    def result(self, seconds: float) -> T:
        """Return the call's value, or raise what it raised.

        Raises:
            Late: no result within `seconds`.
        """
        if not wait([self._future], seconds).done:
            raise Late(f"no answer within {seconds:.1f} s")
        return self._future.result()
