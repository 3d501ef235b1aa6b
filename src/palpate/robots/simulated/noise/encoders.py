"""Joint encoders: reported angles against true ones."""

from __future__ import annotations

import math

import numpy as np

from palpate.geometry.pose import Array
from palpate.robots.nominal import RIDGE
from palpate.robots.simulated.noise.disturbances import Rests
from palpate.robots.simulated.noise.gauge import Relaxation
from palpate.robots.simulated.noise.model import NoiseModel
from palpate.robots.simulated.noise.values import JOINTS, Streams
from palpate.robots.simulated.timing import BLOCK, PERIOD

PAD_TIME = 0.02
"""s in which pads give way, sqrt(m c) for an arm's 8 kg on 5e-5 m/N: hard objects of the world ring
under an impact, and pads would not."""
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
        self._ripple = math.sqrt(2.0) * pose.encoder_ripple.size
        self._cycles = pose.encoder_ripple.cycles
        self._phase = streams("pose.encoder_ripple").uniform(-np.pi, np.pi, JOINTS)
        self._noise, self._random = pose.encoder, streams.run("pose.encoder")
        self._noisy, self._step = bool(pose.encoder.any()), pose.quantisation
        self.exact = not (self._compliance.any() or self._ripple.any() or self.soft)
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
        return q + self._compliance * torque + self._ripple * np.sin(self._cycles * q + self._phase)

    def pressed(self, jacobian: Array, force: Array, axis: Array) -> Array:
        """Compute how far (n, 7), rad, the arm went on while its pads gave way.

        Args:
            jacobian: (6, 7), world axes about the TCP.
            force: (n,) N of n log periods; it is low-passed in place.
            axis: (3,) unit vector along which the pads press.
        """
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
