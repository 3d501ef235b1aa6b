"""Stamps against time: a clock that stands, goes back or leaps, and sensors that live in another."""

from __future__ import annotations

from palpate.robots.description import Limits
from palpate.robots.robot import RobotState
from palpate.robots.sense.fault import Fault
from palpate.trace.samples import Samples

STALLED = 5
"""Advances after which a clock that has not moved stands."""

BY_ITSELF = 30.0
"""s that may pass unasked on a real arm, whose time goes on while a computer thinks, or is kept busy by
others: that is not the clock's fault."""


class Clock:
    """The robot's time, and the stamps of its samples."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._state: RobotState | None = None
        self._asked, self._waits = 0.0, 0
        self._sample: float | None = None

    def ask(self, duration: float) -> None:
        """The robot is told to let `duration` s pass."""
        self._asked += duration
        self._waits += 1

    def follow(self, state: RobotState) -> Fault | None:
        """Take the next state. Samples that are merely old are the safety predicate's business."""
        before, self._state = self._state, state
        if before is None:
            self._asked, self._waits = 0.0, 0
            return None
        passed, late = state.t - before.t, self._limits.stale_after
        stale = state.t - state.stamp > late
        if passed < 0.0 or (state.stamp < before.stamp and not stale):
            what = f"from {before.stamp:.3f} s to {state.stamp:.3f} s"
            return Fault("time goes back", what, before.t)
        if state.stamp > state.t + late:
            what = f"sensor data is stamped {state.stamp - state.t:.2f} s ahead of its time"
            return Fault("time leaps", what, before.t)
        unasked = BY_ITSELF if state.mode else late
        if passed > self._asked + unasked:
            what = f"{passed:.2f} s passed where {self._asked:.2f} s were asked for"
            return Fault("time leaps", what, before.t)
        if passed == 0.0 and self._waits >= STALLED:
            what = f"{self._asked:.2f} s were asked for, and none passed"
            return Fault("time stands", what, before.t)
        if passed > 0.0:
            self._asked, self._waits = 0.0, 0
        return None

    def order(self, samples: Samples, now: float) -> Fault | None:
        """Look at the stamps of new samples, at robot time `now`."""
        last = self._sample
        for t in samples.t.tolist():
            if last is not None and t <= last:
                return Fault("time goes back", f"a sample of {t:.3f} s after {last:.3f} s", last)
            last = t
        self._sample = last
        late = self._limits.stale_after
        if last is not None and last > now + late:
            return Fault("time leaps", f"a sample of {last:.3f} s at {now:.3f} s", now)
        if last is not None and now - last > late:
            return Fault("no samples", f"none for {now - last:.2f} s", last)
        return None
