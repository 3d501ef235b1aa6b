"""A simulated run at the pace of a real one, so that a person can follow it."""

from __future__ import annotations

import time

from palpate.execution.runner import Snapshot


class RealTime:
    """Lets no more robot time pass than time does. An `Observer` of simulated arms alone: a real one
    must not wait for anybody."""

    def __init__(self) -> None:
        self._root: object = None
        self._began = 0.0

    def progress(self, stage: str) -> None:
        """Only motions take their time."""

    def on_tick(self, snapshot: Snapshot) -> None:
        """Wait until as much time has passed as on the robot's clock."""
        if snapshot.root is not self._root:
            self._root, self._began = snapshot.root, time.monotonic() - snapshot.elapsed
        early = snapshot.elapsed - (time.monotonic() - self._began)
        if early > 0:
            time.sleep(early)
