"""Bounded-jerk motions: piecewise quintic polynomials in time, from any state of motion to rest."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import mujoco
import numpy as np

from palpate.geometry.pose import Array, Pose

PEAK_SPEED = 1.875
"""Peak over mean speed of a quintic from rest to rest (minimum jerk)."""
PEAK_ACCELERATION = 5.7735
"""Peak acceleration times T^2 over distance, likewise."""
RAMP_ACCELERATION = 1.5
"""Peak acceleration times T over the change of speed of a quintic from one steady speed to
another."""
SHORTEST = 0.05
"""s: no stop is quicker."""
SHORTEST_RAMP = 0.1
"""s: no other change of speed is quicker."""
RAMP_WAY = 0.75
"""Way of such a change of speed, times acceleration, over the difference of the squared speeds."""
NOTHING = 1e-9
"""s: pieces of a motion that are shorter are none."""
SWING_PEAK = 1.12
"""Peak acceleration of a swing over that of its sine: as it grows and fades."""
SWING_PIECES = 16
"""Pieces of a period of a sine: a quintic each is off by less than a millionth of its amplitude."""
LONGEST_BRAKING = 1.0
"""s: more is not given to a motion that begins at speed and has almost no way to go."""

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
        """When it comes to rest, s."""
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


class Stretch(NamedTuple):
    """A part of a way: where it ends, as a share of the whole, and how fast it may be gone."""

    end: float
    speed: float


def stretches(speeds: Sequence[float] | Array) -> list[Stretch]:
    """Equal parts of a way."""
    return [Stretch((i + 1) / len(speeds), float(speed)) for i, speed in enumerate(speeds)]


def slowed(one: Sequence[Stretch], other: Sequence[Stretch]) -> list[Stretch]:
    """What both of two divisions of a way allow; where the second has none, the first."""
    both: list[Stretch] = []
    for end in sorted({part.end for part in (*one, *other)}):
        speeds: list[float] = []
        for parts in filter(None, (one, other)):
            # What is beyond the last part is gone like it.
            speeds.append(next((p.speed for p in parts if p.end >= end), parts[-1].speed))
        both.append(Stretch(end, min(speeds)))
    return both


def straight(
    t: float, now: Motion, goal: Array, parts: Sequence[Stretch], acceleration: float
) -> Path:
    """To rest at `goal`, from rest along a straight line; from a state of motion along a smooth
    curve, as slowly as the slowest stretch.

    The `parts` follow each other up to 1; speeds and `acceleration` are per displacement: 0.5
    crosses it in no less than 2 s. On every stretch the motion goes steadily as fast as it may and
    can; it changes its speed in the faster one of two, so that it enters the slower one slowly.
    """
    if np.any(now.v):
        return _single(t, now, goal, min(part.speed for part in parts), acceleration)
    pieces = [p for p in _pieces(parts, acceleration) if p.duration > NOTHING]
    durations = [piece.duration for piece in pieces]
    share = np.concatenate([_share(piece) for piece in pieces], axis=1).T
    coefficients = share[:, :, None] * (goal - now.p)
    coefficients[:, 0] += now.p
    return Path(t + np.cumsum([0.0, *durations]), coefficients)


class _Piece(NamedTuple):
    """A change of speed, or a steady motion: its duration, where it begins and ends, as shares of
    the way, and how fast it is there."""

    duration: float
    start: float
    end: float
    before: float
    after: float


def _pieces(stretches: Sequence[Stretch], acceleration: float) -> Iterator[_Piece]:
    """One after the other, in order, from rest to rest."""
    start = 0.0
    bounds = _at_bounds(stretches, acceleration)
    for stretch, (before, after) in zip(stretches, pairwise(bounds), strict=True):
        length = stretch.end - start
        fits = (length * acceleration / RAMP_WAY + before**2 + after**2) / 2
        steady = max(min(stretch.speed, fits**0.5), before, after)
        rise, fall = _ramp(before, steady, acceleration), _ramp(steady, after, acceleration)
        rising, falling = rise * (before + steady) / 2, fall * (steady + after) / 2
        if rising + falling > length * (1 + 1e-9):  # too short for more than one change of speed
            yield _short(start, stretch.end, before, after, acceleration)
        else:
            risen, falls = start + rising, stretch.end - falling
            yield _Piece(rise, start, risen, before, steady)
            yield _Piece((falls - risen) / steady, risen, falls, steady, steady)
            yield _Piece(fall, falls, stretch.end, steady, after)
        start = stretch.end


def _at_bounds(stretches: Sequence[Stretch], acceleration: float) -> list[float]:
    """How fast the motion may be where each stretch begins, and at the end, so that it can speed
    up to that, and slow down to the next."""
    speeds = [0.0]
    for one, other in pairwise(stretches):
        speeds.append(min(one.speed, other.speed))
    speeds.append(0.0)
    starts = [0.0, *(stretch.end for stretch in stretches)]
    lengths = [end - start for start, end in pairwise(starts)]
    for i, length in enumerate(lengths):
        speeds[i + 1] = min(speeds[i + 1], _reached(speeds[i], length, acceleration))
    for i in range(len(lengths) - 1, -1, -1):
        speeds[i] = min(speeds[i], _reached(speeds[i + 1], lengths[i], acceleration))
    return speeds


def _reached(speed: float, length: float, acceleration: float) -> float:
    return (speed**2 + length * acceleration / RAMP_WAY) ** 0.5


def _ramp(before: float, after: float, acceleration: float) -> float:
    """s that a change of speed takes."""
    change = abs(after - before)
    return max(SHORTEST_RAMP, RAMP_ACCELERATION * change / acceleration) if change else 0.0


def _short(start: float, end: float, before: float, after: float, acceleration: float) -> _Piece:
    """All of a stretch in one change of speed."""
    length = end - start
    if before + after:
        return _Piece(2 * length / (before + after), start, end, before, after)
    duration = max(2 * SHORTEST, (PEAK_ACCELERATION * length / acceleration) ** 0.5)
    return _Piece(duration, start, end, 0.0, 0.0)


def _share(piece: _Piece) -> Array:
    """Coefficients (6, 1) of one piece."""
    zero = np.zeros(1)
    start = Motion(np.array([piece.start]), np.array([piece.before]), zero)
    end = Motion(np.array([piece.end]), np.array([piece.after]), zero)
    return quintic(start, end, piece.duration)


def _single(t: float, now: Motion, goal: Array, speed: float, acceleration: float) -> Path:
    whole = max(float(np.abs(goal - now.p).max()), 1e-9)
    braking = 2 * float(np.abs(now.v).max()) / (acceleration * whole)
    duration = max(
        2 * SHORTEST,
        PEAK_SPEED / speed,
        (PEAK_ACCELERATION / acceleration) ** 0.5,
        min(braking, LONGEST_BRAKING),
    )
    rest = np.zeros_like(goal)
    return Path(np.array([t, t + duration]), quintic(now, Motion(goal, rest, rest), duration)[None])


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


@dataclass(frozen=True, slots=True, eq=False)
class PosePath:
    """A pose as a function of time: position and, relative to `origin`, rotation vector on one
    `Path`."""

    path: Path
    origin: Array
    """(4,) quaternion, wxyz."""

    @property
    def end(self) -> float:
        """When it comes to rest, s."""
        return self.path.end

    def pose(self, t: float) -> Pose:
        """The pose at one time."""
        row = self.path.sample(np.array([t]))
        return Pose(row[0, :3], turned(self.origin, row[:, 3:])[0])

    def motion(self, t: float) -> Motion:
        """Position and rotation vector *from the present orientation*: (6,) and their rates."""
        now = self.path.at(t)
        turning = np.zeros(3)
        if np.any(now.v[3:]):
            step = 1e-4
            ahead, here = self.pose(t + step).quaternion, self.pose(t).quaternion
            mujoco.mju_subQuat(turning, ahead, here)
            turning /= step
        zero = np.zeros(3)
        return Motion(
            np.concatenate([now.p[:3], zero]),
            np.concatenate([now.v[:3], turning]),
            np.concatenate([now.a[:3], zero]),
        )


def rotation_vector(start: Array, goal: Array) -> Array:
    """(3,) rad, in the frame of `start`, of the shortest turn from one quaternion to another."""
    out = np.empty(3)
    mujoco.mju_subQuat(out, goal, start)
    return out


def turned(origin: Array, rotation_vectors: Array) -> Array:
    """`origin` turned by each rotation vector (m, 3) in its own frame, (m, 4)."""
    if not rotation_vectors.any():
        return np.broadcast_to(origin, (len(rotation_vectors), 4))
    angle = np.sqrt((rotation_vectors * rotation_vectors).sum(1))
    half = np.sinc(angle / (2 * np.pi))[:, None] / 2 * rotation_vectors
    w, (x, y, z) = np.cos(angle / 2), half.T
    a, b, c, d = origin
    return np.stack(
        [
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y - b * z + c * w + d * x,
            a * z + b * y - c * x + d * w,
        ],
        axis=1,
    )
