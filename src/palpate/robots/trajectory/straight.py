"""A straight way from rest to rest, on every stretch as fast as it may be gone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from palpate.geometry.pose import Array
from palpate.robots.trajectory.path import RAMP_ACCELERATION, SHORTEST, Motion, Path, quintic

PEAK_SPEED = 1.875
"""Peak over mean speed of a quintic from rest to rest (minimum jerk)."""
PEAK_ACCELERATION = 5.7735
"""Peak acceleration times T^2 over distance, likewise."""
SHORTEST_RAMP = 0.1
"""s: no other change of speed is quicker."""
RAMP_WAY = 0.75
"""Way of such a change of speed, times acceleration, over the difference of the squared speeds."""
NOTHING = 1e-9
"""s: pieces of a motion that are shorter are none."""
LONGEST_BRAKING = 1.0
"""s: more is not given to a motion that begins at speed and has almost no way to go."""


class Stretch(NamedTuple):
    """A part of a way: where it ends, as a share of the whole, and how fast it may be gone."""

    end: float
    speed: float


def stretches(speeds: Sequence[float] | Array) -> list[Stretch]:
    """Equal parts of a way."""
    return [Stretch((i + 1) / len(speeds), float(speed)) for i, speed in enumerate(speeds)]


def slowed(one: Sequence[Stretch], other: Sequence[Stretch]) -> list[Stretch]:
    """Return the lower of two speed profiles along a path; the first, where the second is empty."""
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
    """Yield the pieces in order, from rest to rest."""
    start = 0.0
    bounds = _at_bounds(stretches, acceleration)
    for stretch, (before, after) in zip(stretches, pairwise(bounds), strict=True):
        length = stretch.end - start
        fits = (length * acceleration / RAMP_WAY + before**2 + after**2) / 2
        steady = max(min(stretch.speed, fits**0.5), before, after)
        rise, fall = _ramp(before, steady, acceleration), _ramp(steady, after, acceleration)
        rising, falling = rise * (before + steady) / 2, fall * (steady + after) / 2
        if rising + falling > length * (1 + 1e-9):  # too short for more than one change of speed
            yield _short(start, stretch, before, after, acceleration)
        else:
            risen, falls = start + rising, stretch.end - falling
            yield _Piece(rise, start, risen, before, steady)
            yield _Piece((falls - risen) / steady, risen, falls, steady, steady)
            yield _Piece(fall, falls, stretch.end, steady, after)
        start = stretch.end


def _at_bounds(stretches: Sequence[Stretch], acceleration: float) -> list[float]:
    """Compute the largest speed at the start of each stretch and at the end that the acceleration
    limit can reach, and brake from in time."""
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


def _short(
    start: float, stretch: Stretch, before: float, after: float, acceleration: float
) -> _Piece:
    """All of a stretch in one change of speed, or from rest to rest."""
    length = stretch.end - start
    if before + after:
        return _Piece(2 * length / (before + after), start, stretch.end, before, after)
    shortest = (PEAK_ACCELERATION * length / acceleration) ** 0.5
    duration = max(2 * SHORTEST, PEAK_SPEED * length / stretch.speed, shortest)
    return _Piece(duration, start, stretch.end, 0.0, 0.0)


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
