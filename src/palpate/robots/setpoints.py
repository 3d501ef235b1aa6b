"""A motion's set-points, computed once for all its 1 ms steps."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from palpate.pose import Array
from palpate.robots.trajectory import Path, PosePath
from palpate.robots.world import BLOCK, TIMESTEP

LONGEST_RUN = 10
"""Log periods that pass between two updates of the feed-forward torques, at most: 20 Hz."""


class Setpoints:
    """Rows of a path, ready to slice; after its end the last one stays.

    Attributes:
        path: what they are of.
    """

    def __init__(self, path: Path | PosePath, start: float, pose: Callable[[Array], Array] | None = None) -> None:
        """Of `path` from time `start`, s, on. `pose` makes commanded poses (n, 7) of rows that are not poses."""
        self.path, self._start = path, start
        steps = max(0, round((path.end - start) / TIMESTEP))
        steps += -steps % BLOCK
        rows = path.sample(start + TIMESTEP * np.arange(1, steps + 2))
        self._end = steps
        self._rows = np.concatenate([rows, np.repeat(rows[-1:], LONGEST_RUN * BLOCK, axis=0)])
        middles = self._rows[BLOCK // 2::BLOCK]
        self._poses = middles if pose is None else pose(middles)

    def take(self, t: float, n: int) -> tuple[Array, Array]:
        """Set-points of the next `n` steps after time `t`, and the commanded poses of their log periods (n / 5, 7)."""
        first = min(round((t - self._start) / TIMESTEP), self._end)
        block = first // BLOCK
        return self._rows[first:first + n], self._poses[block:block + n // BLOCK]
