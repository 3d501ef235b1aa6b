"""Straight motions from rest to rest, as fast on every stretch as its limit allows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from palpate.geometry.pose import Array
from palpate.robots.trajectory.path import RAMP_ACCELERATION, SHORTEST, Motion, Path, quintic

PEAK_SPEED = 1.875  # peak over mean speed of a quintic from rest to rest (minimum jerk)
PEAK_ACCELERATION = 5.7735  # its peak acceleration times T^2 over distance
SHORTEST_RAMP = 0.1  # s: no other change of speed is quicker
RAMP_WAY = 0.75
"""Distance of such a change of speed, times acceleration, over the difference of the squared speeds."""
NOTHING = 1e-9  # s: shorter pieces of a motion are dropped
LONGEST_BRAKING = 1.0  # s, limit for a motion that begins at speed close to its goal


class Stretch(NamedTuple):
    """A part of a straight motion."""

    end: float  # as a share of the whole distance
    speed: float  # limit


class Piece(NamedTuple):
    """A change of speed, or a steady motion."""

    duration: float
    start: float  # as a share of the whole distance
    end: float
    before: float  # speed at the start
    after: float


def stretches(speeds: Sequence[float] | Array) -> list[Stretch]:
    """Divide a motion into equal parts with these speed limits."""
    return [Stretch((i + 1) / len(speeds), float(speed)) for i, speed in enumerate(speeds)]


def slowed(one: Sequence[Stretch], other: Sequence[Stretch]) -> list[Stretch]:
    """Return the lower of two speed profiles along a path; the first, where the second is empty."""
    both: list[Stretch] = []
    for end in sorted({part.end for part in (*one, *other)}):
        speeds: list[float] = []
        for parts in filter(None, (one, other)):
            # Beyond its end the last part goes on.
            speeds.append(next((p.speed for p in parts if p.end >= end), parts[-1].speed))
        both.append(Stretch(end, min(speeds)))
    return both


def straight(
    t: float, now: Motion, goal: Array, parts: Sequence[Stretch], acceleration: float
) -> Path:
    """Move to rest at `goal`, from rest along a straight line; from a state of motion along a smooth
    curve, at the speed of the slowest stretch.

    The `parts` end at 1; speeds and `acceleration` are per displacement: 0.5 crosses it in no less
    than 2 s. On every stretch the motion is steady at its limit, if it can reach it; it changes its
    speed in the faster one of two, so that it enters the slower one slowly.
    """
    if np.any(now.v):
        return _curve(t, now, goal, min(part.speed for part in parts), acceleration)
    pieces = [p for p in _pieces(parts, acceleration) if p.duration > NOTHING]
    zero = np.zeros(1)
    shares: list[Array] = []
    for piece in pieces:
        start = Motion(np.array([piece.start]), np.array([piece.before]), zero)
        end = Motion(np.array([piece.end]), np.array([piece.after]), zero)
        shares.append(quintic(start, end, piece.duration))
    coefficients = np.concatenate(shares, axis=1).T[:, :, None] * (goal - now.p)
    coefficients[:, 0] += now.p
    return Path(t + np.cumsum([0.0, *(piece.duration for piece in pieces)]), coefficients)


def _pieces(stretches: Sequence[Stretch], acceleration: float) -> Iterator[Piece]:
    """Yield the pieces in order, from rest to rest."""
    start = 0.0
    bounds = bound_speeds(stretches, acceleration)
    for stretch, (before, after) in zip(stretches, pairwise(bounds), strict=True):
        length = stretch.end - start
        fits = (length * acceleration / RAMP_WAY + before**2 + after**2) / 2
        steady = max(min(stretch.speed, fits**0.5), before, after)
        rise, fall = ramp_time(before, steady, acceleration), ramp_time(steady, after, acceleration)
        rising, falling = rise * (before + steady) / 2, fall * (steady + after) / 2
        if rising + falling <= length * (1 + 1e-9):
            risen, falls = start + rising, stretch.end - falling
            yield Piece(rise, start, risen, before, steady)
            yield Piece((falls - risen) / steady, risen, falls, steady, steady)
            yield Piece(fall, falls, stretch.end, steady, after)
        elif before + after:  # too short for more than one change of speed
            yield Piece(2 * length / (before + after), start, stretch.end, before, after)
        else:  # from rest to rest
            shortest = (PEAK_ACCELERATION * length / acceleration) ** 0.5
            duration = max(2 * SHORTEST, PEAK_SPEED * length / stretch.speed, shortest)
            yield Piece(duration, start, stretch.end, 0.0, 0.0)
        start = stretch.end


def bound_speeds(stretches: Sequence[Stretch], acceleration: float) -> list[float]:
    """Compute the largest speed at the start of each stretch and at the end that the acceleration
    limit can reach, and brake from in time."""
    inner = [min(one.speed, other.speed) for one, other in pairwise(stretches)]
    speeds = [0.0, *inner, 0.0]
    starts = [0.0, *(stretch.end for stretch in stretches)]
    lengths = [end - start for start, end in pairwise(starts)]

    def reached(speed: float, length: float) -> float:
        return (speed**2 + length * acceleration / RAMP_WAY) ** 0.5

    for i, length in enumerate(lengths):
        speeds[i + 1] = min(speeds[i + 1], reached(speeds[i], length))
    for i in range(len(lengths) - 1, -1, -1):
        speeds[i] = min(speeds[i], reached(speeds[i + 1], lengths[i]))
    return speeds


def ramp_time(before: float, after: float, acceleration: float) -> float:
    """Compute the duration of a change of speed, s."""
    change = abs(after - before)
    return max(SHORTEST_RAMP, RAMP_ACCELERATION * change / acceleration) if change else 0.0


def _curve(t: float, now: Motion, goal: Array, speed: float, acceleration: float) -> Path:
    """Move from a state of motion to rest at `goal` in one quintic."""
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
