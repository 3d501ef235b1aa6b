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
        self._state = np.zeros((2, JOINTS))
        self._maps: dict[int, Array] = {}

    def passed(self, ripple: Array) -> Array:
        """Filter the next inputs (n, 7)."""
        given = np.concatenate([self._state, ripple])
        if len(ripple) not in self._maps:
            self._maps[len(ripple)] = self._map(len(ripple))
        out = (self._maps[len(ripple)] @ given.T[:, :, None])[:, :, 0].T
        self._state = out[:2]
        return np.where(self._acts, out[2:], ripple)

    def _map(self, count: int) -> Array:
        """Compute the matrices (7, 2 + count, 2 + count) from state and inputs to the state after them and the
        outputs: the filter's answers to each alone."""
        each = np.broadcast_to(np.eye(2 + count)[:, None], (2 + count, JOINTS, 2 + count))
        s1, s2, out = each[0], each[1], list[Array]()
        b, a1, a2 = (one[:, None] for one in (self._b, self._a1, self._a2))
        for now in each[2:]:
            here = b * now + s1
            s1, s2 = 2.0 * b * now - a1 * here + s2, b * now - a2 * here
            out.append(here)
        return np.stack([s1, s2, *out], axis=1)
