"""Observers of a world, called after every physics step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, runtime_checkable

import mujoco

Watch = Callable[[mujoco.MjData], None]


@runtime_checkable
class Undoing(Protocol):
    """Observer that can undo steps: the world then takes many at once, and goes back where the arm stops itself
    among them."""

    def __call__(self, data: mujoco.MjData) -> None: ...

    def mark(self) -> Callable[[], None]:
        """Return what undoes all steps from here on."""
        ...


def takes_many(watch: Watch | None) -> bool:
    """True if the world may take many steps at once before it knows that none is undone."""
    return watch is None or isinstance(watch, Undoing)


def marked(watch: Watch | None) -> Callable[[], None]:
    """Return what undoes all steps from here on."""
    # None first: an instance test against a protocol is slow.
    return watch.mark() if watch is not None and isinstance(watch, Undoing) else lambda: None
