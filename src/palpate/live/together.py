"""Several views of one run."""

from __future__ import annotations

from typing import Protocol

from palpate.execution.runner import Snapshot


class View(Protocol):
    """An observer that also names stages."""

    def on_tick(self, snapshot: Snapshot) -> None: ...

    def progress(self, stage: str) -> None: ...


class Together:
    """Tells all views what one is told. An `Observer`."""

    def __init__(self, *views: View) -> None:
        self._views = views

    def on_tick(self, snapshot: Snapshot) -> None:
        """See `Observer`."""
        for view in self._views:
            view.on_tick(snapshot)

    def progress(self, stage: str) -> None:
        """Name the present stage of the work."""
        for view in self._views:
            view.progress(stage)
