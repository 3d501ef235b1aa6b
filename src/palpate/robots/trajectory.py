"""Bounded-jerk motions: piecewise quintic polynomials in time, from any state of motion to rest."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import mujoco
import numpy as np

from palpate.common.pose import Array, Pose

SHORTEST = 0.05  # s: shortest duration of a stop
# Peak acceleration times T, over the change of speed, of a quintic between two steady speeds.
RAMP_ACCELERATION = 1.5
SWING_PEAK = 1.12  # peak acceleration of a swing over that of its sine, while it grows or fades
# Quintics per period of a sine: the error is less than a millionth of the sine's amplitude.
SWING_PIECES = 16
PEAK_SPEED = 1.875  # peak over mean speed of a quintic from rest to rest (minimum jerk)
PEAK_ACCELERATION = 5.7735  # peak acceleration of the same quintic times T^2 over distance
SHORTEST_RAMP = 0.1  # s: shortest duration of another change of speed
# Distance of a change of speed, times acceleration, over the difference of the squared speeds.
RAMP_WAY = 0.75
NOTHING = 1e-9  # s: shorter pieces of a motion are dropped
LONGEST_BRAKING = 1.0  # s: limit for a motion that begins close to its goal and at speed
_POWERS = np.arange(6)


class MotionState(NamedTuple):
    """A state of motion: position, velocity and acceleration, each (n,)."""

    p: Array
    v: Array
    a: Array


@dataclass(frozen=True, slots=True, eq=False)
class PositionPath:
    """Positions (n,) as a function of time; at rest before its start and after its end."""

    knots: Array  # (k + 1,) times between the segments, s
    coefficients: Array  # (k, 6, n) of the powers of the time since the segment's knot

    @property
    def end(self) -> float:
        """Time at which it comes to rest, s."""
        return float(self.knots[-1])

    def sample(self, t: Array) -> Array:
        """Compute the positions (m, n) at ascending times `t` (m,)."""
        # Clip the times, and sort them into segments.
        t = np.minimum(np.maximum(t, self.knots[0]), self.knots[-1])
        edges = [0, *np.searchsorted(t, self.knots[1:-1]).tolist(), len(t)]
        parts = [
            np.vander(t[a:b] - knot, 6, increasing=True) @ coefficients
            for a, b, knot, coefficients in zip(
                edges, edges[1:], self.knots, self.coefficients, strict=False
            )
        ]
        return np.concatenate(parts)

    def at(self, t: float) -> MotionState:
        """Compute the state of motion at time `t`."""
        if t >= self.end:
            rest = np.zeros(self.coefficients.shape[2])
            return MotionState(self.sample(np.array([t]))[0], rest, rest)
        # Evaluate the segment's polynomial and its two derivatives at the time since its knot.
        i = int(np.searchsorted(self.knots[1:-1], t, side="right"))
        c, s = self.coefficients[i], max(t - self.knots[i], 0.0)
        powers = s**_POWERS
        velocity = c[1:] * _POWERS[1:, None]
        acceleration = c[2:] * (_POWERS[2:] * _POWERS[1:-1])[:, None]
        return MotionState(powers @ c, powers[:5] @ velocity, powers[:4] @ acceleration)


@dataclass(frozen=True, slots=True, eq=False)
class PosePath:
    """A pose as a function of time: position and rotation vector on one `PositionPath`."""

    path: PositionPath
    origin: Array  # (4,) quaternion, wxyz, that the rotation vector is relative to

    @property
    def end(self) -> float:
        """Time at which it comes to rest, s."""
        return self.path.end

    def pose(self, t: float) -> Pose:
        """Compute the pose at time `t`."""
        row = self.path.sample(np.array([t]))
        return Pose(row[0, :3], rotate_quaternion(self.origin, row[:, 3:])[0])

    def motion(self, t: float) -> MotionState:
        """Compute position and rotation vector (6,), *relative to the present orientation*, and their rates."""
        now = self.path.at(t)
        # The angular velocity is a finite difference of orientations.
        turning = np.zeros(3)
        if np.any(now.v[3:]):
            step = 1e-4
            turning = rotation_vector(self.pose(t).quaternion, self.pose(t + step).quaternion)
            turning /= step
        zero = np.zeros(3)
        return MotionState(
            np.concatenate([now.p[:3], zero]),
            np.concatenate([now.v[:3], turning]),
            np.concatenate([now.a[:3], zero]),
        )


def quaternion_matrix(quaternion: Array) -> Array:
    """Return the matrix (4, 4) of left multiplication by a quaternion (4,), wxyz."""
    w, x, y, z = quaternion
    return np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])


def rotation_vector(start: Array, goal: Array) -> Array:
    """Compute the shortest turn (3,), rad, in the frame of `start`, from one quaternion to another."""
    out = np.empty(3)
    mujoco.mju_subQuat(out, goal, start)
    return out


def wrist_turn(start: Array, goal: Array, twist: float) -> Array:
    """Compute the turn (3,), rad, in the frame of `start`, from one quaternion to another.

    It is the shortest turn. Beyond a right angle it is the opposite turn, if that is nearer to the `twist`,
    rad, of the last joint, whose axis is the tool's z. So the wrist avoids a full turn.
    """
    turn = rotation_vector(start, goal)
    angle = float(np.linalg.norm(turn))
    if angle < np.pi / 2:
        return turn
    return min(turn, turn * (1.0 - 2.0 * np.pi / angle), key=lambda one: abs(one[2] - twist))


def rotate_quaternion(origin: Array, rotation_vectors: Array) -> Array:
    """Turn the quaternion `origin` by each rotation vector (m, 3) in its own frame.

    Return quaternions (m, 4), wxyz: the product of `origin` and (cos(a / 2), sin(a / 2) r / a) with
    a = |r|.
    """
    if not rotation_vectors.any():
        return np.broadcast_to(origin, (len(rotation_vectors), 4))
    # The unit quaternion of each rotation vector; sinc keeps small angles exact.
    angle = np.sqrt((rotation_vectors * rotation_vectors).sum(1))
    half = np.sinc(angle / (2 * np.pi))[:, None] / 2 * rotation_vectors
    w, (x, y, z) = np.cos(angle / 2), half.T
    # Hamilton product, row by row.
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


def quintic(start: MotionState, end: MotionState, duration: float) -> Array:
    """Compute the coefficients (6, n) of the quintic polynomial between two states of motion."""
    # The first three coefficients are the start; the others meet position, velocity and acceleration at the
    # end.
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


def still(t: float, p: Array) -> PositionPath:
    """Return a path that stays at `p` (n,)."""
    coefficients = np.zeros((1, 6, len(p)))
    coefficients[0, 0] = p
    return PositionPath(np.array([t, t]), coefficients)


def stop(
    t: float, now: MotionState, acceleration: float, shortest: float = SHORTEST
) -> PositionPath:
    """Stop with onward motion, at about `acceleration` (of the largest component), in at least `shortest` s."""
    duration = max(shortest, RAMP_ACCELERATION * float(np.abs(now.v).max()) / acceleration)
    rest = np.zeros_like(now.p)
    end = MotionState(now.p + now.v * duration / 2, rest, rest)
    return PositionPath(np.array([t, t + duration]), quintic(now, end, duration)[None])


def swing(
    t: float, about: MotionState, amplitude: Array, frequency: float, cycles: int
) -> PositionPath:
    """Swing about a state of rest: a sine of `amplitude` (n,) and `frequency` Hz for `cycles` periods.

    The sine grows in one period before and fades in one period after, and ends at its start.
    """
    # Sample position, velocity and acceleration of the sine at evenly spaced knots.
    whole = (cycles + 2) / frequency
    times = np.linspace(0.0, whole, SWING_PIECES * (cycles + 2) + 1)
    states: list[MotionState] = []
    for time in times.tolist():
        p, v, a = fading_sine(time * frequency, cycles)
        rates = v * frequency * amplitude, a * frequency**2 * amplitude
        states.append(MotionState(about.p + p * amplitude, *rates))
    # One quintic per knot interval matches the states at both of its ends.
    duration = whole / (len(states) - 1)
    coefficients = [quintic(one, other, duration) for one, other in pairwise(states)]
    return PositionPath(t + times, np.array(coefficients))


def fading_sine(period: float, cycles: int) -> tuple[float, float, float]:
    """Compute a sine times its envelope, at a time in periods: the value and two derivatives."""
    share, way = (period, 1.0) if period < 1.0 else (cycles + 2 - period, -1.0)
    share = min(share, 1.0)
    # The envelope is the quintic step from 0 to 1 that begins and ends at rest.
    e0 = share**3 * (10 - 15 * share + 6 * share**2)
    e1 = way * 30 * share**2 * (1 - share) ** 2
    e2 = 60 * share * (1 - share) * (1 - 2 * share)
    # The product rule gives the derivatives of envelope times sine.
    turn = 2 * np.pi
    s0, s1 = np.sin(turn * period), turn * np.cos(turn * period)
    s2 = -(turn**2) * s0
    return float(e0 * s0), float(e1 * s0 + e0 * s1), float(e2 * s0 + 2 * e1 * s1 + e0 * s2)


class Stretch(NamedTuple):
    """A part of a straight motion."""

    end: float  # as a share of the whole distance
    speed: float  # limit


class SpeedPiece(NamedTuple):
    """A change of speed, or a steady motion."""

    duration: float
    start: float  # as a share of the whole distance
    end: float
    before: float  # speed at the start
    after: float


def stretches(speeds: Sequence[float] | Array) -> list[Stretch]:
    """Divide a motion into equal parts with these speed limits."""
    return [Stretch((i + 1) / len(speeds), float(speed)) for i, speed in enumerate(speeds)]


def lower_profile(one: Sequence[Stretch], other: Sequence[Stretch]) -> list[Stretch]:
    """Return the lower of two speed profiles along a path; the first profile, where the second is empty."""
    both: list[Stretch] = []
    # A stretch that ends at its start, as of a motion on the spot, has no speed.
    for end in sorted({part.end for part in (*one, *other) if part.end > 0}):
        speeds: list[float] = []
        for parts in filter(None, (one, other)):
            # The last part extends beyond its end.
            speeds.append(next((p.speed for p in parts if p.end >= end), parts[-1].speed))
        both.append(Stretch(end, min(speeds)))
    return both


def straight(
    t: float, now: MotionState, goal: Array, parts: Sequence[Stretch], acceleration: float
) -> PositionPath:
    """Move to rest at `goal`: from rest along a straight line, from a state of motion along a smooth curve.

    The `parts` end at 1. Speeds and `acceleration` are relative to the displacement: 0.5 1/s covers it in no
    less than 2 s. On every stretch the motion is steady at its limit, if it can reach that speed. A change of
    speed lies in the faster stretch of two, so that the slower one is entered slowly. The curve has the speed
    of the slowest stretch.
    """
    if np.any(now.v):
        return _curve(t, now, goal, min(part.speed for part in parts), acceleration)
    # One quintic per piece, as a share of the distance.
    pieces = [p for p in _pieces(parts, acceleration) if p.duration > NOTHING]
    zero = np.zeros(1)
    shares: list[Array] = []
    for piece in pieces:
        start = MotionState(np.array([piece.start]), np.array([piece.before]), zero)
        end = MotionState(np.array([piece.end]), np.array([piece.after]), zero)
        shares.append(quintic(start, end, piece.duration))
    # Scale the shares to positions between start and goal.
    coefficients = np.concatenate(shares, axis=1).T[:, :, None] * (goal - now.p)
    coefficients[:, 0] += now.p
    return PositionPath(t + np.cumsum([0.0, *(piece.duration for piece in pieces)]), coefficients)


def _pieces(stretches: Sequence[Stretch], acceleration: float) -> Iterator[SpeedPiece]:
    """Yield the pieces in order, from rest to rest."""
    start = 0.0
    bounds = bound_speeds(stretches, acceleration)
    for stretch, (before, after) in zip(stretches, pairwise(bounds), strict=True):
        # The largest steady speed that leaves room for both changes of speed.
        length = stretch.end - start
        fits = (length * acceleration / RAMP_WAY + before**2 + after**2) / 2
        steady = max(min(stretch.speed, fits**0.5), before, after)
        rise, fall = ramp_time(before, steady, acceleration), ramp_time(steady, after, acceleration)
        rising, falling = rise * (before + steady) / 2, fall * (steady + after) / 2
        # Accelerate, move steadily, and slow down.
        if rising + falling <= length * (1 + 1e-9):
            risen, falls = start + rising, stretch.end - falling
            yield SpeedPiece(rise, start, risen, before, steady)
            yield SpeedPiece((falls - risen) / steady, risen, falls, steady, steady)
            yield SpeedPiece(fall, falls, stretch.end, steady, after)
        elif before + after:  # too short for more than one change of speed
            yield SpeedPiece(2 * length / (before + after), start, stretch.end, before, after)
        else:  # too short for a steady part: from rest to rest
            shortest = (PEAK_ACCELERATION * length / acceleration) ** 0.5
            duration = max(2 * SHORTEST, PEAK_SPEED * length / stretch.speed, shortest)
            yield SpeedPiece(duration, start, stretch.end, 0.0, 0.0)
        start = stretch.end


def bound_speeds(stretches: Sequence[Stretch], acceleration: float) -> list[float]:
    """Compute the largest reachable speed at the start of each stretch and at the end.

    The acceleration limit bounds it forwards from the start, and backwards from the stop at the end.
    """
    inner = [min(one.speed, other.speed) for one, other in pairwise(stretches)]
    speeds = [0.0, *inner, 0.0]
    starts = [0.0, *(stretch.end for stretch in stretches)]
    lengths = [end - start for start, end in pairwise(starts)]

    def reachable_speed(speed: float, length: float) -> float:
        return (speed**2 + length * acceleration / RAMP_WAY) ** 0.5

    # Forward pass: speeds that the acceleration can reach. Backward pass: speeds from which it can brake.
    for i, length in enumerate(lengths):
        speeds[i + 1] = min(speeds[i + 1], reachable_speed(speeds[i], length))
    for i in range(len(lengths) - 1, -1, -1):
        speeds[i] = min(speeds[i], reachable_speed(speeds[i + 1], lengths[i]))
    return speeds


def ramp_time(before: float, after: float, acceleration: float) -> float:
    """Compute the duration of a change of speed, s."""
    change = abs(after - before)
    return max(SHORTEST_RAMP, RAMP_ACCELERATION * change / acceleration) if change else 0.0


def _curve(
    t: float, now: MotionState, goal: Array, speed: float, acceleration: float
) -> PositionPath:
    """Move from a state of motion to rest at `goal` in one quintic."""
    # The longest of the limits on speed, acceleration and braking decides.
    whole = max(float(np.abs(goal - now.p).max()), 1e-9)
    braking = 2 * float(np.abs(now.v).max()) / (acceleration * whole)
    duration = max(
        2 * SHORTEST,
        PEAK_SPEED / speed,
        (PEAK_ACCELERATION / acceleration) ** 0.5,
        min(braking, LONGEST_BRAKING),
    )
    rest = np.zeros_like(goal)
    return PositionPath(
        np.array([t, t + duration]), quintic(now, MotionState(goal, rest, rest), duration)[None]
    )
