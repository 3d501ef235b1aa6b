"""Estimate of a run's remaining time, from its steps so far."""

from __future__ import annotations

import time
from collections import defaultdict
from statistics import fmean

from palpate.execution.leaf import PrimitiveLeaf
from palpate.execution.runner import Snapshot

FEWEST = 3
"""Steps that have to have ended before anything is said."""


class Remaining:
    """Foresees the end of a run: a step that is still to come takes as long as those of its kind did,
    and robot time passes as fast as it did."""

    def __init__(self) -> None:
        self._began = time.monotonic()

    def seconds(self, snapshot: Snapshot) -> float | None:
        """s of wall time; None while too little is known, or while the run is being stopped."""
        if len(snapshot.leaves) < FEWEST or snapshot.stopping is not None or not snapshot.elapsed:
            return None
        took: dict[str, list[float]] = defaultdict(list)
        for leaf in snapshot.leaves:
            took[leaf.primitive].append(leaf.end - leaf.start)
        usual = fmean(leaf.end - leaf.start for leaf in snapshot.leaves)
        ended = {leaf.node for leaf in snapshot.leaves}
        robot_time = 0.0
        for node in snapshot.root.iterate():
            if isinstance(node, PrimitiveLeaf) and node.node not in ended:
                kind = took.get(type(node.primitive).__name__)
                robot_time += fmean(kind) if kind else usual
        return robot_time * (time.monotonic() - self._began) / snapshot.elapsed
