"""Friction behind the torque sensors, in bearings, seals and cables: what the wrench sees of it."""

from __future__ import annotations

import math

import numpy as np

from palpate.geometry.pose import Array
from palpate.robots.simulated.noise.model import Friction
from palpate.robots.simulated.noise.motion import Motion
from palpate.robots.simulated.noise.values import JOINTS, Streams


class JointFriction:
    """Dahl's model of presliding with a level that may depend on speed (Stribeck), load and angle.

    Per rad of motion the torque closes 1 / presliding of the way to plus or minus its level: P.
    Dahl, "Solid friction damping of mechanical vibrations", AIAA Journal 14 (1976); with a level of
    the speed it is LuGre's steady state (C. Canudas de Wit et al., IEEE TAC 40 (1995)).
    """

    def __init__(self, friction: Friction, period: float, streams: Streams) -> None:
        self._model, self._period = friction, period
        spread = 1.0 + friction.spread.draw(streams("friction.spread"))
        self._level = friction.coulomb * np.maximum(spread, 0.0)
        self._turned = streams("friction.position").uniform(-np.pi, np.pi, JOINTS)
        self.torque = self._level * streams.run("friction.coulomb").uniform(-1.0, 1.0, JOINTS)
        """(7,) N m now, in the direction of the last motion."""
        self._varies = friction.static > 1 or friction.load.any() or friction.position.any()
        self._viscous = bool(friction.viscous.any())
        self.none = not (self._level.any() or self._viscous or friction.load.any())

    def add(self, torque: Array, motion: Motion) -> None:
        """Add it to the link-side torques (n, 7), N m."""
        dq, model = motion.dq, self._model
        keep = np.exp(np.abs(dq) * (-self._period / model.presliding))
        level = self._levels(torque, motion) if self._varies else self._level
        pull = np.copysign(level * (1.0 - keep), dq)
        held = np.empty_like(dq)
        for i in range(len(dq)):
            self.torque *= keep[i]
            self.torque += pull[i]
            held[i] = self.torque
        torque += held
        if self._viscous:
            torque += model.viscous * dq
        if model.compensated:
            torque -= model.compensated * model.coulomb * np.sign(dq)

    def _levels(self, torque: Array, motion: Motion) -> Array:
        """(n, 7) N m that the friction tends to."""
        model = self._model
        around = math.sqrt(2.0) * model.position * np.sin(motion.q + self._turned)
        level = self._level * np.maximum(1.0 + around, 0.0) + model.load * np.abs(torque)
        slow = np.exp(-((motion.dq / model.stribeck_speed) ** 2))
        return level * (1.0 + (model.static - 1.0) * slow)
