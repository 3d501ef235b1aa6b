"""Quintic polynomials in time, one after another: positions, and their rates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.geometry.pose import Array

SHORTEST = 0.05
"""s: no stop is quicker."""
RAMP_ACCELERATION = 1.5
"""Peak acceleration times T over the change of speed of a quintic from one steady speed to
another."""
_POWERS = np.arange(6)


class Motion(NamedTuple):
    """A state of motion: position, velocity and acceleration, each (n,)."""

    p: Array
    v: Array
    a: Array


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """Positions (n,) as a function of time; before its start and after its end it stands still.

    Attributes:
        knots: (k + 1,) times at which one segment gives way to the next, s.
        coefficients: (k, 6, n) of the powers of the time since the segment's knot.
    """

    knots: Array
    coefficients: Array

    @property
    def end(self) -> float:
        """Time at which it comes to rest, s."""
        return float(self.knots[-1])

    def sample(self, t: Array) -> Array:
        """Positions (m, n) at times `t` (m,), ascending."""
        t = np.minimum(np.maximum(t, self.knots[0]), self.knots[-1])
        edges = [0, *np.searchsorted(t, self.knots[1:-1]).tolist(), len(t)]
        parts = [
            np.vander(t[a:b] - knot, 6, increasing=True) @ coefficients
            for a, b, knot, coefficients in zip(
                edges, edges[1:], self.knots, self.coefficients, strict=False
            )
        ]
        return np.concatenate(parts)

    def at(self, t: float) -> Motion:
        """The state of motion at time `t`."""
        if t >= self.end:
            rest = np.zeros(self.coefficients.shape[2])
            return Motion(self.sample(np.array([t]))[0], rest, rest)
        i = int(np.searchsorted(self.knots[1:-1], t, side="right"))
        c, s = self.coefficients[i], max(t - self.knots[i], 0.0)
        powers = s**_POWERS
        velocity, acceleration = (
            c[1:] * _POWERS[1:, None],
            c[2:] * (_POWERS[2:] * _POWERS[1:-1])[:, None],
        )
        return Motion(powers @ c, powers[:5] @ velocity, powers[:4] @ acceleration)


def still(t: float, p: Array) -> Path:
    """No motion at all."""
    coefficients = np.zeros((1, 6, len(p)))
    coefficients[0, 0] = p
    return Path(np.array([t, t]), coefficients)


def quintic(start: Motion, end: Motion, duration: float) -> Array:
    """Coefficients (6, n) of the polynomial that meets both states of motion."""
    d, h = duration, end.p - start.p - start.v * duration - start.a * duration**2 / 2
    dv, da = (end.v - start.v - start.a * d) * d, (end.a - start.a) * d**2
    return np.stack(
        [
            start.p,
            start.v,
            start.a / 2,
            (10 * h - 4 * dv + da / 2) / d**3,
            (-15 * h + 7 * dv - da) / d**4,
            (6 * h - 3 * dv + da / 2) / d**5,
        ]
    )


def stop(t: float, now: Motion, acceleration: float, shortest: float = SHORTEST) -> Path:
    """To rest, onwards, at about `acceleration` (the largest component's), in at least `shortest`
    s."""
    duration = max(shortest, RAMP_ACCELERATION * float(np.abs(now.v).max()) / acceleration)
    rest = np.zeros_like(now.p)
    end = Motion(now.p + now.v * duration / 2, rest, rest)
    return Path(np.array([t, t + duration]), quintic(now, end, duration)[None])
