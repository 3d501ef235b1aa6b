"""Ripple: errors periodic in a joint's angle, and the resonance of a control loop that they excite."""

from __future__ import annotations

import math

import numpy as np

from palpate.geometry.pose import Array
from palpate.robots.simulated.noise.model import JOINTS, EncoderRipple, Resonance


class Waves:
    """Two harmonics of a ripple, with the phases of a robot.

    Attributes:
        none: True if the ripple is zero.
    """

    def __init__(self, ripple: EncoderRipple, random: np.random.Generator) -> None:
        sizes = [ripple.size, ripple.second] if ripple.second.any() else [ripple.size]
        self.none = not np.any(sizes)
        self._parts = [
            (math.sqrt(2.0) * size, k * ripple.cycles, random.uniform(-np.pi, np.pi, JOINTS))
            for k, size in enumerate(sizes, start=1)
        ]

    def at(self, q: Array) -> Array:
        """Compute the ripple (n, 7) at joint angles (n, 7), rad."""
        total = np.zeros(q.shape)
        for size, cycles, phase in self._parts:
            total += size * np.sin(cycles * q + phase)
        return total


class Resonator:
    """Second-order low pass of seven joints, by the bilinear transform with its natural frequency
    kept."""

    def __init__(self, resonance: Resonance, period: float) -> None:
        # A joint without a resonance passes its ripple on.
        self._acts = np.isfinite(resonance.frequency)
        omega = 2 * np.pi * np.where(self._acts, resonance.frequency, 1.0)
        g = np.tan(np.minimum(omega * period, 0.95 * np.pi) / 2)
        scale = 1.0 / (1.0 + 2.0 * resonance.damping * g + g * g)
        self._b = g * g * scale
        self._a1 = 2.0 * (g * g - 1.0) * scale
        self._a2 = (1.0 - 2.0 * resonance.damping * g + g * g) * scale
        self._s1 = self._s2 = np.zeros(JOINTS)

    def passed(self, ripple: Array) -> Array:
        """Filter the next inputs (n, 7)."""
        out = np.empty_like(ripple)
        for i, now in enumerate(ripple):
            shown = self._b * now
            out[i] = here = shown + self._s1
            self._s1 = 2.0 * shown - self._a1 * here + self._s2
            self._s2 = shown - self._a2 * here
        return np.where(self._acts, out, ripple)
