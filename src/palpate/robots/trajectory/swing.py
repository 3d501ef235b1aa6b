"""To and fro about a state of rest."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from palpate.geometry.pose import Array
from palpate.robots.trajectory.path import Motion, Path, quintic

SWING_PEAK = 1.12
"""Peak acceleration of a swing over that of its sine: as it grows and fades."""
SWING_PIECES = 16
"""Pieces of a period of a sine: a quintic each is off by less than a millionth of its amplitude."""


def swing(t: float, about: Motion, amplitude: Array, frequency: float, cycles: int) -> Path:
    """To and fro about a state of rest: a sine of `amplitude` (n,) and `frequency` Hz for `cycles`
    periods, between one in which it grows and one in which it fades; it ends where it began."""
    whole = (cycles + 2) / frequency
    times = np.linspace(0.0, whole, SWING_PIECES * (cycles + 2) + 1)
    states = [_swung(time * frequency, cycles) for time in times.tolist()]
    coefficients: list[Array] = []
    for one, other in pairwise(states):
        ends = [
            Motion(
                about.p + p * amplitude,
                v * frequency * amplitude,
                a * frequency**2 * amplitude,
            )
            for p, v, a in (one, other)
        ]
        coefficients.append(quintic(ends[0], ends[1], whole / len(states[1:])))
    return Path(t + times, np.array(coefficients))


def _swung(period: float, cycles: int) -> tuple[float, float, float]:
    """A sine within its envelope, at a time in periods: its value and two derivatives by it."""
    share, way = (period, 1.0) if period < 1.0 else (cycles + 2 - period, -1.0)
    share = min(share, 1.0)
    # The smoothest step from 0 to 1 that begins and ends at rest, a quintic.
    e0 = share**3 * (10 - 15 * share + 6 * share**2)
    e1 = way * 30 * share**2 * (1 - share) ** 2
    e2 = 60 * share * (1 - share) * (1 - 2 * share)
    turn = 2 * np.pi
    s0, s1 = np.sin(turn * period), turn * np.cos(turn * period)
    s2 = -(turn**2) * s0
    return float(e0 * s0), float(e1 * s0 + e0 * s1), float(e2 * s0 + 2 * e1 * s1 + e0 * s2)
