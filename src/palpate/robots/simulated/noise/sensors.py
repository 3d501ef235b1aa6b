"""Sensors of the arm: joint encoders, and joint torque sensors."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.geometry.pose import Array
from palpate.robots.nominal import RIDGE
from palpate.robots.simulated.noise.disturbances import (
    BaseVibration,
    Cable,
    Motion,
    Rests,
)
from palpate.robots.simulated.noise.friction import JointFriction
from palpate.robots.simulated.noise.gauge import Gauges, Relaxation, Wander
from palpate.robots.simulated.noise.line import Line
from palpate.robots.simulated.noise.model import JOINTS, NoiseModel, Streams
from palpate.robots.simulated.noise.ripple import Waves
from palpate.robots.simulated.timing import BLOCK, PERIOD

PAD_TIME = 0.02
"""s in which pads give way, sqrt(m c) for an arm's 8 kg on 5e-5 m/N: hard objects of the world ring
under an impact, and pads would not."""
NOTHING = 1e-6  # N: pads that nothing presses are 0.1 nm from their shape
YIELDS = -math.expm1(-PERIOD / PAD_TIME)  # share of it in a log period


class Encoders:
    """Errors of the joint angles, and of the TCP's position that follows from them.

    Attributes:
        exact: True if reported angles are the true ones, up to noise.
        clean: True if they have no noise.
        soft: m/N, compliance of the pads under a probe: the arm goes on, as its encoders see.
    """

    def __init__(self, noise: NoiseModel, rests: Rests, streams: Streams) -> None:
        pose, model = noise.pose, noise.model
        self._rests = rests
        self._compliance = model.joint_compliance.draw(streams("model.joint_compliance"))
        self.soft = model.pad_compliance.number(streams("model.pad_compliance"))
        self._pressed = 0.0
        self._waves = Waves(pose.encoder_ripple, streams("pose.encoder_ripple"))
        self._noise, self._random = pose.encoder, streams.run("pose.encoder")
        self._noisy, self._step = bool(pose.encoder.any()), pose.quantisation
        self.exact = self._waves.none and not (self._compliance.any() or self.soft)
        self.clean = not (self._noisy or pose.quantisation)
        self._thermal = None
        if pose.thermal:
            time = noise.torque.drift.time_constant
            self._thermal = Relaxation(pose.thermal, time, streams.run("pose.thermal"), 3)

    @property
    def pose_error(self) -> Array:
        """(3,) m, world axes: reported less true position of the TCP, without the angles' part."""
        if self._thermal is None:
            return self._rests.pose_error
        return self._rests.pose_error + self._thermal.value

    def pass_time(self, periods: int) -> None:
        """Advance the thermal expansion of the links by some log periods."""
        if self._thermal is not None:
            self._thermal.after(periods * PERIOD)

    def reported(self, q: Array, torque: Array) -> Array:
        """Return the reported angles (n, 7), rad, of true ones (n, 7) under link-side torques
        (n, 7), N m: the encoders sit before the compliance of the joints."""
        if self.exact:
            return q
        reported = q + self._compliance * torque
        return reported if self._waves.none else reported + self._waves.at(q)

    def pressed(self, jacobian: Array, force: Array, axis: Array) -> Array:
        """Compute how far (n, 7), rad, the arm went on while its pads gave way.

        Args:
            jacobian: (6, 7), world axes about the TCP.
            force: (n,) N of n log periods; it is low-passed in place.
            axis: (3,) unit vector along which the pads press.
        """
        if self._pressed < NOTHING and force.max() <= 0.0:
            self._pressed = 0.0
            return np.zeros((len(force), JOINTS))
        for i, pressing in enumerate(np.maximum(force, 0.0).tolist()):
            self._pressed += (pressing - self._pressed) * YIELDS
            force[i] = self._pressed
        forward = np.concatenate([axis, np.zeros(3)])
        along = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + RIDGE, forward)
        return self.soft * force[:, None] * along

    def noise(self, periods: int) -> Array | None:
        """Draw the noise (periods, 7), rad, of block means; None without any."""
        if not self._noisy:
            return None
        return self._noise / math.sqrt(BLOCK) * self._random.standard_normal((periods, JOINTS))

    def quantised(self, q: Array) -> Array:
        """Round angles (n, 7), rad, to whole steps."""
        return np.round(q / self._step) * self._step if self._step else q


class Measured(NamedTuple):
    """Measurement of n log periods."""

    torque: Array  # (n, 7) N m
    arrived: NDArray[np.bool_] | None  # (n,) which of them did, None for all
    # (7,) N m, the last reading before white noise and acquisition errors: the arm's own reflex uses
    # it with the noise of each look
    shown: Array


class Sensors:
    """Errors of the joint torque sensors, whose state follows the arm's motion.

    Attributes:
        rests: errors of each rest, among them that of the reported pose.
        line: acquisition of the torque samples.
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
        self.line = Line(torque, noise.acquisition, streams)
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
        return Measured(*self.line.carry(reading), shown)

    def looks(self, count: int) -> Array:
        """Draw the white noise (count, 7), N m, of single 1 kHz samples."""
        if not self._noisy:
            return np.zeros((count, JOINTS))
        return self._white * self._looks.standard_normal((count, JOINTS))
