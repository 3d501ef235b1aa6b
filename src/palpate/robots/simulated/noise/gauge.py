"""The torque sensors themselves: from the torque that bends them to what they read."""

from __future__ import annotations

import math

import numpy as np

from palpate.geometry.pose import Array
from palpate.robots.simulated.noise.model import Torque
from palpate.robots.simulated.noise.values import JOINTS, Streams

THRESHOLDS = 8
"""Play operators that make up the hysteresis; each is half as wide as the one before."""
WIDEST = 0.25
"""Of the range: the widest of them."""
LOOP = math.sqrt(2.0)
"""Width of a loop of swing S over w S, at weights w: between 1 and 2, by where S lies between two
thresholds."""


class Gauges:
    """Seven sensors with their robot's own gains, cross-talk, curvature, hysteresis and ripple."""

    def __init__(self, torque: Torque, tau_max: Array, streams: Streams) -> None:
        self._matrix = np.diag(1.0 + torque.gain_max.draw(streams("torque.gain_max")))
        crosstalk = torque.crosstalk.draw(streams("torque.crosstalk"))
        self._matrix += crosstalk - np.diag(np.diag(crosstalk))
        self._gain = np.diag(self._matrix).copy()
        self._crossed = torque.crosstalk.any
        self._full = np.where(np.isfinite(torque.range), torque.range, tau_max)
        bent = torque.nonlinearity_max
        self._bent = (
            bent.draw(streams("torque.nonlinearity_max")) / self._full if bent.any else None
        )
        self._ripple = math.sqrt(2.0) * torque.ripple.size
        self._rippled = bool(self._ripple.any())
        self._cycles = torque.ripple.cycles
        self._phase = streams("torque.ripple").uniform(-np.pi, np.pi, JOINTS)
        self._weight = torque.hysteresis / LOOP
        self._lags = bool(self._weight.any())
        self._half = WIDEST * self._full * 0.5 ** np.arange(THRESHOLDS)[:, None]
        self._follows: Array | None = None

    def read(self, torque: Array, q: Array) -> Array:
        """(n, 7) N m that are shown of the torques (n, 7) behind the gears, at angles (n, 7)."""
        reading = torque @ self._matrix.T if self._crossed else self._gain * torque
        if self._bent is not None:
            reading += self._bent * torque * torque
        if self._lags:
            reading -= self._weight * self._lag(torque)
        if self._rippled:
            reading += self._ripple * np.sin(self._cycles * q + self._phase)
        return reading

    def _lag(self, torque: Array) -> Array:
        """(n, 7) N m by which play operators of all widths lag behind, together: a Prandtl-Ishlinskii
        model, whose loops are as wide as the swing since the last reversal is long (P. Krejci,
        "Hysteresis, Convexity and Dissipation in Hyperbolic Equations", 1996)."""
        if self._follows is None:
            self._follows = np.broadcast_to(torque[0], self._half.shape).copy()
        lag = np.empty_like(torque)
        for i, now in enumerate(torque):
            np.clip(self._follows, now - self._half, now + self._half, out=self._follows)
            lag[i] = (now - self._follows).sum(0)
        return lag
