"""Forces on the arm that its model does not know: a cable that pulls, a base that shakes."""

from __future__ import annotations

import math

import numpy as np

from palpate.geometry.pose import Array
from palpate.robots.simulated.noise.model import Vibration
from palpate.robots.simulated.noise.motion import Motion
from palpate.robots.simulated.noise.values import Streams
from palpate.trace.samples import STANDARD_GRAVITY

REACH = 0.3
"""m over which the pull of a cable changes."""
WAVES = 48
"""Random waves of which its field is made."""


class Cable:
    """A force at the TCP that varies smoothly over the workspace.

    A Gaussian random field with the covariance exp(-d^2 / 2 REACH^2), by random Fourier features
    (A. Rahimi, B. Recht, "Random features for large-scale kernel machines", NIPS 2007).
    """

    def __init__(self, size: float, streams: Streams) -> None:
        random = streams("model.payload_cable")
        self._waves = random.standard_normal((3, WAVES)) / REACH
        self._phases = random.uniform(-np.pi, np.pi, WAVES)
        self._pull = size * math.sqrt(2.0 / WAVES) * random.standard_normal((WAVES, 3))

    def force(self, position: Array) -> Array:
        """(n, 3) N at positions (n, 3) of the TCP, m."""
        return np.cos(position @ self._waves + self._phases) @ self._pull

    def add(self, torque: Array, motion: Motion) -> None:
        """Add it to the link-side torques (n, 7), N m."""
        torque += self.force(motion.position) @ motion.jacobian[:3]


class Shaking:
    """Up and down acceleration of the base: arm and load weigh that much more or less."""

    def __init__(self, vibration: Vibration, period: float, streams: Streams) -> None:
        self._omega = 2 * math.pi * vibration.frequency
        self._phase = streams.run("environment.vibration").uniform(-np.pi, np.pi)
        within = self._omega * period / 2  # a block's mean is less than its middle
        self._size = math.sqrt(2.0) * vibration.acceleration * np.sinc(within / np.pi)
        self._period, self._t = period, 0.0

    def add(self, torque: Array) -> None:
        """Add it to the link-side torques (n, 7), N m, nearly all of which are weight."""
        times = self._t + self._period * (np.arange(len(torque)) + 0.5)
        self._t += len(torque) * self._period
        acceleration = self._size * np.sin(self._omega * times + self._phase)
        torque += torque * (acceleration / STANDARD_GRAVITY)[:, None]
