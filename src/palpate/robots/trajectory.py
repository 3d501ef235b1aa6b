"""Bounded-jerk motions: piecewise quintic polynomials in time, from any state of motion to rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from palpate.geometry.pose import Array, Pose

PEAK_SPEED = 1.875
"""Peak over mean speed of a quintic from rest to rest (minimum jerk)."""
PEAK_ACCELERATION = 5.7735
"""Peak acceleration times T^2 over distance, likewise."""
RAMP_ACCELERATION = 1.5
"""Peak acceleration times T over speed of a quintic from rest to a steady speed."""
SHORTEST = 0.05
"""s: no change of speed is quicker."""
SHORTEST_RAMP = 0.1
"""s: from rest to a steady speed."""
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


def straight(t: float, now: Motion, goal: Array, speed: float, acceleration: float) -> Path:
    """To rest at `goal`, from rest along a straight line; from a state of motion along a smooth
    curve.

    `speed` and `acceleration` are per displacement: 0.5 crosses it in no less than 2 s. From rest a
    long motion ramps, cruises at `speed` and ramps down; a short one, or one that replaces another
    under way, is one quintic.
    """
    ramp = max(SHORTEST_RAMP, RAMP_ACCELERATION * speed / acceleration)
    if np.any(now.v) or speed * ramp > 1.0:
        return _single(t, now, goal, speed, acceleration)
    whole, rest = goal - now.p, np.zeros_like(now.p)
    cruise = whole * speed
    risen = Motion(now.p + cruise * ramp / 2, cruise, rest)
    falling = Motion(goal - cruise * ramp / 2, cruise, rest)
    steady = 1.0 / speed - ramp
    middle = np.zeros((6, len(goal)))
    middle[0], middle[1] = risen.p, cruise
    return Path(
        t + np.cumsum([0.0, ramp, steady, ramp]),
        np.stack(
            [quintic(now, risen, ramp), middle, quintic(falling, Motion(goal, rest, rest), ramp)]
        ),
    )


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
