"""The robot's clock: how fast it goes, and how well its samples are stamped."""

from __future__ import annotations

import numpy as np

from palpate.geometry.pose import Array
from palpate.robots.simulated.noise.model import Acquisition
from palpate.robots.simulated.noise.values import Streams
from palpate.robots.simulated.timing import PERIOD

LATEST = 0.45
"""Of a log period, how far a stamp may be off: samples stay in order."""


class Stamps:
    """Robot time of the world's."""

    def __init__(self, acquisition: Acquisition, streams: Streams) -> None:
        self.rate = 1.0 + acquisition.clock.number(streams("acquisition.clock"))
        """s of robot time in a second."""
        self._jitter, self._random = acquisition.jitter, streams.run("acquisition.jitter")

    def of(self, t: Array) -> Array:
        """(n,) s, stamps of samples taken at times `t` (n,), s, of the world."""
        if not self._jitter:
            return self.rate * t
        off = self._jitter * self._random.standard_normal(len(t))
        return self.rate * t + np.clip(off, -LATEST * PERIOD, LATEST * PERIOD)
