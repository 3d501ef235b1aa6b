"""A film in the making, beside other work: what draws it does without Python's lock."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from typing import TypeVar

from palpate.pictures.footage import Footage
from palpate.pictures.moments import Film, film, frames_of
from palpate.pictures.renderer import gl_available
from palpate.trace.samples import Trace

T = TypeVar("T")


class Filming:
    """Makes the film of what a camera saw, on a thread of its own. A context manager; what is not
    done when it is left is given up."""

    def __init__(self, footage: Footage, trace: Trace | None) -> None:
        self._given_up = threading.Event()
        self._thread = ThreadPoolExecutor(1, "film")
        self._film = self._thread.submit(self._made, footage, trace)

    def film(self) -> Film | None:
        """The film, when it is done; None without frames or OpenGL.

        Raises:
            RuntimeError: OpenGL failed.
            OSError: it cannot be encoded.
        """
        return self._film.result()

    def next(self, work: Callable[[], T]) -> Future[T]:
        """Do `work` on the same thread, when the film is done."""
        return self._thread.submit(work)

    def _made(self, footage: Footage, trace: Trace | None) -> Film | None:
        if not gl_available()[0]:
            return None
        t, qpos = frames_of(footage.frames)
        drawn = footage.drawn(soft=False)
        made = film(footage.model, t, qpos, trace, drawn=drawn, given_up=self._given_up.is_set)
        return None if made is None else replace(made, believed=footage.believed)

    def __enter__(self) -> Filming:
        return self

    def __exit__(self, *_: object) -> None:
        self._given_up.set()
        self._thread.shutdown(cancel_futures=True)
