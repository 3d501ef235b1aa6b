"""Joint torque sensing: measured torques of true ones."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.geometry.pose import Array
from palpate.robots.simulated.noise.disturbances import (
    BaseVibration,
    Cable,
    JointFriction,
    Motion,
    Rests,
)
from palpate.robots.simulated.noise.gauge import Gauges, Wander
from palpate.robots.simulated.noise.line import Line
from palpate.robots.simulated.noise.model import NoiseModel
from palpate.robots.simulated.noise.values import JOINTS, Streams
from palpate.robots.simulated.timing import PERIOD


class Measured(NamedTuple):
    """Measurement of n log periods.

    Attributes:
        torque: (n, 7) N m.
        arrived: (n,) which of them did, None for all.
        shown: (7,) N m, the last reading before white noise and acquisition errors: the arm's own
            reflex sees it with the noise of each look.
    """

    torque: Array
    arrived: NDArray[np.bool_] | None
    shown: Array


class Sensors:
    """Errors of the joint torque sensors, whose state follows the arm's motion.

    Attributes:
        rests: errors of each rest, among them that of the reported pose.
    """

    def __init__(self, noise: NoiseModel, tau_max: Array, streams: Streams) -> None:
        """`tau_max` (7,) N m: the range of a sensor where the model states none."""
        torque, vibration = noise.torque, noise.environment.vibration
        self._friction = JointFriction(noise.friction, PERIOD, streams)
        self.rests = Rests(noise.sticking, noise.pose, PERIOD, streams)
        pull = noise.model.payload_cable
        self._cable = Cable(pull, streams) if pull else None
        self._vibration = None
        if vibration.acceleration:
            self._vibration = BaseVibration(vibration, PERIOD, streams)
        self._gauges = Gauges(torque, tau_max, streams)
        self._wander = Wander(torque, PERIOD, streams)
        self._line = Line(torque, noise.acquisition, streams)
        self._white, self._looks = torque.white, streams.run("torque.white.looks")
        self._noisy = bool(torque.white.any())
        self._zero = np.zeros(JOINTS)

    def zero(self, torque: Array, nominal: Array, start: Motion) -> None:
        """Zero the sensors at rest: at the true `torque` (7,) they show the `nominal` one (7,), up to
        the error of zeroing. `start`: one log period of the resting arm."""
        here = torque[None] + self._friction.torque
        if self._cable is not None:
            self._cable.add(here, start)
        shown = self._gauges.read(here, start.q)[0]
        self._zero = shown + self._wander.now - nominal - self._wander.left

    def measure(self, torque: Array, motion: Motion) -> Measured:
        """Simulate the measurement of the true mean torques (n, 7) behind the gears, N m."""
        torque = torque.copy()
        if self._vibration is not None:
            self._vibration.add(torque)
        if not self._friction.none:
            self._friction.add(torque, motion)
        if not self.rests.none:
            self.rests.add(torque, motion)
        if self._cable is not None:
            self._cable.add(torque, motion)
        reading = self._gauges.read(torque, motion.q)
        self._wander.add(reading)
        reading -= self._zero
        shown = reading[-1].copy()
        return Measured(*self._line.carry(reading), shown)

    def looks(self, count: int) -> Array:
        """Draw the white noise (count, 7), N m, of single 1 kHz samples."""
        if not self._noisy:
            return np.zeros((count, JOINTS))
        return self._white * self._looks.standard_normal((count, JOINTS))
