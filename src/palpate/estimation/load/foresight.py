"""Predicted precision of a load after planned passes: the covariance of the fit needs the planned motion and
the noise, but no measured values."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.agreement import KNOWN
from palpate.estimation.coloured import Spans
from palpate.estimation.load.fit import foreseen
from palpate.estimation.load.noise import Noise
from palpate.estimation.load.observation import WrenchObservation
from palpate.estimation.load.segments import Segment, Weighing
from palpate.geometry.pose import Array
from palpate.trace.recording import Hand

NEAR = 2.0 * tuning.CLEARANCE
"""m of a pass that are near a support."""
PASSES = (("down", False), ("up", True), ("down", True), ("up", False))
"""Of one cycle, and whether loaded: empty, loaded, loaded, empty, so that a drift cancels."""


@dataclass(frozen=True, slots=True, eq=False)
class Lift:
    """Planned straight lift.

    Attributes:
        q: (2, m) joint angles at the grasp and above it, rad.
        length: m.
        near_speed: m/s, the fastest near a support.
        acceleration: m/s².
        observed: wrench observation of the arm; its signals are not used.
        white: (m,) (N m)² s, variance of a signal's mean over 1 s.
        flicker: (m,), see `Noise`.
    """

    q: Array
    length: float
    near_speed: float
    acceleration: float
    observed: WrenchObservation
    white: Array
    flicker: Array

    def seconds(self, speed: float) -> float:
        """Robot time of one cycle at `speed` m/s."""
        near = min(NEAR, self.length)
        slowly = near / min(speed, self.near_speed) + speed / self.acceleration
        return len(PASSES) * ((self.length - near) / speed + slowly + tuning.HANDLING)

    def noise(self, cycles: int, speed: float, weight: float, gravity: float, hand: Hand) -> float:
        """N, 1 sigma of a load of `weight` N after some cycles at `speed` m/s, by noise alone."""
        exact = replace(hand, torque_gain=0.0, gain_covariance=None)
        return float(np.sqrt(foreseen(self._weighing(cycles, speed), weight, gravity, exact)))

    def floor(self, cycles: int, speed: float, weight: float, gravity: float, hand: Hand) -> float:
        """N, 1 sigma of it by the gains, which no further cycle makes smaller."""
        noise = self.noise(cycles, speed, weight, gravity, hand)
        whole = foreseen(self._weighing(cycles, speed), weight, gravity, hand)
        return float(np.sqrt(max(whole - noise**2, 0.0)))

    def _weighing(self, cycles: int, speed: float) -> Weighing:
        segments: list[Segment] = []
        start = 0.0
        for grasp in range(cycles):
            for kind, loaded in PASSES:
                segments.append(self._pass(kind, loaded, float(grasp), start, speed))
                start += self.length / speed + tuning.HANDLING
        noise = Noise(self.white, self.flicker, KNOWN)
        return Weighing(segments, noise, self.observed.scale)

    def _pass(self, kind: str, loaded: bool, grasp: float, start: float, speed: float) -> Segment:
        """The steady part of a pass, in bins."""
        clear = min(tuning.CLEARANCE, tuning.SHORT_LIFT * self.length) / self.length
        edges = np.linspace(clear, 1.0, tuning.BINS + 1)
        share = (edges[1:] + edges[:-1]) / 2.0
        part = (1.0 - clear) * self.length / tuning.BINS / speed
        gone = share if kind == "up" else 1.0 - share
        q = self.q[0] + share[:, None] * (self.q[1] - self.q[0])
        maps = self.observed.maps(q)
        count = len(self.white)
        t = start + gone * self.length / speed
        turns = np.abs(self.q[1] - self.q[0])
        path = (start * speed / self.length + gone)[:, None] * turns
        every = np.ones((tuning.BINS, 1))
        return Segment(
            kind,
            loaded,
            grasp,
            start=start,
            end=start + self.length / speed,
            t=t,
            path=share * self.length,
            acceleration=np.zeros(tuning.BINS),
            speed2=np.full(tuning.BINS, speed**2),
            maps=maps,
            observed=np.zeros((tuning.BINS, count)),
            variance=np.tile(self.white / part, (tuning.BINS, 1)),
            motion=np.zeros((tuning.BINS, 0)),
            dahl=np.zeros((tuning.BINS, 0, 0)),
            turned=np.zeros(tuning.BINS),
            spans=Spans(t, part * every[:, 0], path, every * turns / tuning.BINS),
        )
