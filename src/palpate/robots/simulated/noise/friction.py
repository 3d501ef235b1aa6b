"""Joint friction behind the torque sensors, in bearings, seals and cables: its level and its laws."""

from __future__ import annotations

import math

import numpy as np

from palpate.geometry.pose import Array
from palpate.robots.simulated.noise.disturbances import Motion
from palpate.robots.simulated.noise.model import JOINTS, Friction, Streams

YIELDS: Array = np.array([0.2, 0.6, 1.0, 2.5])[:, None]
"""Distance over `presliding` at which each element of a Maxwell slip model starts to slide; their
levels are equal."""
MICRO_DAMPING = 0.005  # s, of LuGre's bristles, over their stiffness


class Dahl:
    """Dahl's model: per rad of motion the torque closes 1 / presliding of the way to plus or minus
    its level (P. Dahl, "Solid friction damping of mechanical vibrations", AIAA Journal 14, 1976).
    """

    def __init__(self, presliding: Array, period: float, torque: Array, level: Array) -> None:
        """Start at `torque` (7,) N m; `level` (7,) is the sliding one."""
        self._presliding, self._period, self._torque = presliding, period, torque.copy()

    def held(self, dq: Array, level: Array) -> Array:
        """Compute the torques (n, 7), N m, at rates (n, 7) and levels (n, 7) or (7,)."""
        return self._relaxed(np.exp(np.abs(dq) * (-self._period / self._presliding)), dq, level)

    def _relaxed(self, keep: Array, dq: Array, level: Array) -> Array:
        pull, held = np.copysign(level * (1.0 - keep), dq), np.empty_like(dq)
        for i in range(len(dq)):
            self._torque *= keep[i]
            self._torque += pull[i]
            held[i] = self._torque
        return held


class LuGre(Dahl):
    """LuGre's model: bristles of one stiffness with micro-damping (C. Canudas de Wit, H. Olsson,
    K. Astrom, P. Lischinsky, "A new model for control of systems with friction", IEEE TAC 40, 1995).
    """

    def __init__(self, presliding: Array, period: float, torque: Array, level: Array) -> None:
        super().__init__(presliding, period, torque, level)
        self._stiffness = level / presliding  # N m/rad

    def held(self, dq: Array, level: Array) -> Array:
        level = np.broadcast_to(level, dq.shape)
        rate = np.abs(dq) * self._stiffness  # N m/s
        keep = np.exp(-self._period * rate / np.maximum(level, 1e-9))
        before = self._torque.copy()
        held = self._relaxed(keep, dq, level)
        change = np.diff(held, axis=0, prepend=before[None]) / self._period
        return held + MICRO_DAMPING * change


class MaxwellSlip:
    """Maxwell slip model: elastic elements in parallel, each of which slides at a level of its own
    (F. Al-Bender, V. Lampaert, J. Swevers, "The generalized Maxwell-slip model", IEEE TAC 50, 2005).
    """

    def __init__(self, presliding: Array, period: float, torque: Array, level: Array) -> None:
        self._period, self._yields = period, YIELDS * presliding  # (elements, 7) rad
        share = torque / np.where(level > 0, level, 1.0)
        self._stretch = share * self._yields

    def held(self, dq: Array, level: Array) -> Array:
        """As `Dahl.held`."""
        share = np.empty_like(dq)
        for i, step in enumerate(dq * self._period):
            np.clip(self._stretch + step, -self._yields, self._yields, out=self._stretch)
            share[i] = (self._stretch / self._yields).mean(0)
        return level * share


LAWS = {"dahl": Dahl, "lugre": LuGre, "maxwell_slip": MaxwellSlip}


class JointFriction:
    """Friction by one of `LAWS`, whose level may depend on speed (Stribeck), load and angle.

    Attributes:
        torque: (7,) N m now, in the direction of the last motion.
    """

    def __init__(self, friction: Friction, period: float, streams: Streams) -> None:
        self._model = friction
        spread = 1.0 + friction.spread.draw(streams("friction.spread"))
        self._level = friction.coulomb * np.maximum(spread, 0.0)
        self._phase = streams("friction.position").uniform(-np.pi, np.pi, JOINTS)
        self.torque = self._level * streams.run("friction.coulomb").uniform(-1.0, 1.0, JOINTS)
        self._law = LAWS[friction.law](friction.presliding, period, self.torque, self._level)
        self._varies = friction.static > 1 or friction.load.any() or friction.position.any()
        self._viscous = bool(friction.viscous.any())
        self.none = not (self._level.any() or self._viscous or friction.load.any())

    def add(self, torque: Array, motion: Motion) -> None:
        """Add the friction to the link-side torques (n, 7), N m."""
        dq, model = motion.dq, self._model
        held = self._law.held(dq, self._levels(torque, motion) if self._varies else self._level)
        self.torque = held[-1]
        torque += held
        if self._viscous:
            torque += model.viscous * dq
        if model.compensated:
            torque -= model.compensated * model.coulomb * np.sign(dq)

    def _levels(self, torque: Array, motion: Motion) -> Array:
        """Compute the levels (n, 7), N m, that the friction tends to."""
        model = self._model
        ripple = math.sqrt(2.0) * model.position * np.sin(motion.q + self._phase)
        level = self._level * np.maximum(1.0 + ripple, 0.0) + model.load * np.abs(torque)
        slow = np.exp(-((motion.dq / model.stribeck_speed) ** 2))
        return level * (1.0 + (model.static - 1.0) * slow)
