"""Joint torque signals as the sensors of a real arm tell them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.geometry.pose import Array
from palpate.robots.simulated.noise.around import Cable, Shaking
from palpate.robots.simulated.noise.friction import JointFriction
from palpate.robots.simulated.noise.gauge import Gauges
from palpate.robots.simulated.noise.line import Line
from palpate.robots.simulated.noise.model import NoiseModel
from palpate.robots.simulated.noise.motion import Motion
from palpate.robots.simulated.noise.rests import Rests
from palpate.robots.simulated.noise.values import JOINTS, Streams
from palpate.robots.simulated.noise.wander import Wander
from palpate.robots.simulated.timing import PERIOD


class Measured(NamedTuple):
    """Of n log periods.

    Attributes:
        torque: (n, 7) N m.
        arrived: (n,) which of them did, None for all.
        shown: (7,) N m that the sensors show in the end, before white noise, and before anything
            happens to the samples: what the arm's own reflex sees besides the noise of each look.
    """

    torque: Array
    arrived: NDArray[np.bool_] | None
    shown: Array


class Sensors:
    """Turns true joint torques into measured ones, and keeps the deviation of the reported pose.

    Its state follows the arm's motion, one log period at a time.
    """

    def __init__(self, noise: NoiseModel, tau_max: Array, streams: Streams) -> None:
        """`tau_max` (7,) N m: the range of a sensor whose range the model does not say."""
        torque, environment = noise.torque, noise.environment
        self._friction = JointFriction(noise.friction, PERIOD, streams)
        self.rests = Rests(noise.sticking, noise.pose, PERIOD, streams)
        self._cable = None
        if noise.model.payload_cable:
            self._cable = Cable(noise.model.payload_cable, streams)
        self._shaking = None
        if environment.vibration.acceleration:
            self._shaking = Shaking(environment.vibration, PERIOD, streams)
        self._gauges = Gauges(torque, tau_max, streams)
        self._wander = Wander(torque, PERIOD, streams)
        self._line = Line(torque, noise.acquisition, streams)
        self._white, self._looks = torque.white, streams.run("torque.white.looks")
        self._noisy = bool(torque.white.any())
        self._zero = np.zeros(JOINTS)

    def zero(self, torque: Array, nominal: Array, start: Motion) -> None:
        """Zero the torque sensors at rest: with the true `torque` (7,) they now show the `nominal`
        one, but for what zeroing leaves. `start`: where the arm stands, one period of it."""
        here = torque[None] + self._friction.torque
        if self._cable is not None:
            self._cable.add(here, start)
        shown = self._gauges.read(here, start.q)[0]
        self._zero = shown + self._wander.now - nominal - self._wander.left

    def measure(self, torque: Array, motion: Motion) -> Measured:
        """Simulate the measurement of the true mean torques (n, 7) behind the gears, N m."""
        torque = torque.copy()
        if self._shaking is not None:
            self._shaking.add(torque)
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
        """(count, 7) N m: the noise of single samples, for those who look at every one."""
        if not self._noisy:
            return np.zeros((count, JOINTS))
        return self._white * self._looks.standard_normal((count, JOINTS))
