"""A robot whose sensors go wrong from some moment on, behind the protocol of the one that moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from palpate.robots.robot import RobotState
from palpate.trace.samples import Samples

Bend = Callable[[RobotState, RobotState], RobotState]
"""The state that is shown, of the state when the fault began and the present one."""
BendSamples = Callable[[Samples, RobotState], Samples]
"""The samples that are shown, of those after the fault began, and the state when it did."""


class Faulty:
    """As `robot`, until `moment` (s of robot time)."""

    def __init__(
        self,
        robot: Any,
        moment: float,
        state: Bend = lambda _, now: now,
        samples: BendSamples = lambda samples, _: samples,
    ) -> None:
        self.robot, self.moment = robot, moment
        self._bend, self._samples = state, samples
        self._first: RobotState | None = None
        self._raw: RobotState | None = None
        self._shown: RobotState | None = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self.robot, name)

    @property
    def state(self) -> RobotState:
        now = self.robot.state
        if now.t < self.moment:
            return now
        self._first = self._first or now
        if now is not self._raw:
            self._raw, self._shown = now, self._bend(self._first, now)
        return self._shown

    def drain(self) -> Samples:
        samples = self.robot.drain()
        first = self.state and self._first
        if first is None or not len(samples):
            return samples
        before = samples.where(samples.t < first.t)
        after = samples.where(samples.t >= first.t)
        if not len(after):
            return samples
        return Samples.concatenate([before, self._samples(after, first)])


def stuck(*names: str) -> dict[str, Any]:
    """Signals that stay as they were when the fault began; time goes on."""

    def bend(first: RobotState, now: RobotState) -> RobotState:
        return replace(now, **{name: getattr(first, name) for name in names})

    def samples(after: Samples, first: RobotState) -> Samples:
        held: dict[str, Any] = {}
        for name in names:
            if hasattr(after, name):
                value = getattr(first, name)
                held[name] = getattr(after, name) * 0 + getattr(value, "vector", value)
        return replace(after, **held)

    return {"state": bend, "samples": samples}
