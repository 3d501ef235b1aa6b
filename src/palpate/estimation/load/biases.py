"""Covariance of signals without a load: bias, drift, noise and inertia of the arm, from bin to bin."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.load.segments import Segment, Weighing
from palpate.estimation.motion import Mask
from palpate.geometry.pose import Array


def covariance(weighing: Weighing, maps: Array, apart: float) -> Array:
    """(n, n) of all rows without the load: white noise, biases, the arm's inertia, and drift.

    `apart` is the part (1 sigma) of their bias that kinds of segments have of their own.
    """
    found = weighing.segments
    bins, signals = maps.shape[:2]
    variance = np.concatenate([segment.variance for segment in found])
    bias = _bias(found, apart)
    t = np.concatenate([segment.t for segment in found])
    between = np.abs(t[:, None] - t)
    moved = _moved(found, weighing.scale)
    out = np.zeros((signals * bins, signals * bins))
    for i, scale in enumerate(weighing.scale.tolist()):
        block = scale**2 * (bias + _drift(between)) + weighing.noise.flicker[i] * flicker(between)
        block += _empty(found, i) ** 2
        block += moved[i]
        block += np.diag(variance[:, i] + (tuning.FLOOR * scale) ** 2)
        out[i * bins : (i + 1) * bins, i * bins : (i + 1) * bins] = block
    return out


def _empty(found: Sequence[Segment], signal: int) -> float:
    """Mean of a signal with the empty hand, N m: the scale of its bias where an end effector is
    wrongly configured. The contrast with the load does not depend on it."""
    shown = [float(segment.observed[:, signal].mean()) for segment in found if not segment.loaded]
    return float(np.mean(shown)) if shown else 0.0


def _bias(found: Sequence[Segment], apart: float) -> Array:
    """(bins, bins) N²: covariance of one signal in units of its scale, without noise: constant
    bias; bias along the path, of which each kind has its own part `apart`, and each turn the whole;
    inertia and viscous effects of the motion; residual stiction of rests."""
    kinds = np.concatenate([[segment.kind] * len(segment.t) for segment in found])
    own = np.concatenate([np.full(len(s.t), i) for i, s in enumerate(found)])
    at_rest = np.concatenate([np.full(len(s.t), float(s.at_rest)) for s in found])
    speed2 = np.concatenate([segment.speed2 for segment in found])
    turning = np.concatenate([np.full(len(s.t), s.turns) for s in found])
    place = _places(found, turning)
    powers = np.power.outer(place, np.arange(tuning.DEGREE + 1))
    near = np.maximum(0.0, 1.0 - np.abs(place[:, None] - place) * tuning.BINS / 2.0)
    share = np.where(turning, 1.0, apart)
    moving = tuning.CENTRIFUGAL**2 * np.outer(speed2, speed2)
    moving += tuning.VISCOUS**2 * np.sqrt(np.outer(speed2, speed2))
    along = tuning.KIND_BIAS**2 * (powers @ powers.T) + tuning.BIN_BIAS**2 * near
    same = kinds[:, None] == kinds
    common = np.sqrt(1.0 - share**2)
    out = tuning.FORCE_BIAS**2 + np.outer(common, common) * along
    out += (np.outer(share, share) * along + moving) * same
    rested = (apart * tuning.REST_FRICTION) ** 2
    out += rested * np.outer(at_rest, at_rest) * (own[:, None] == own)
    return out


def _places(found: Sequence[Segment], turning: Mask) -> Array:
    """(bins,) from -1 to 1 along the path; of a turn, along all turns."""
    path = np.concatenate([segment.path for segment in found])
    turned = np.concatenate([segment.turned for segment in found])
    places = np.zeros(len(path))
    for rows, way in ((~turning, path), (turning, turned)):
        if rows.any():
            middle, half = _middle(way[rows])
            places[rows] = (way[rows] - middle) / half
    return places


def _middle(path: Array) -> tuple[float, float]:
    """m: the middle of a path, and how far it goes to either side."""
    low, high = float(path.min()), float(path.max())
    return (high + low) / 2.0, max((high - low) / 2.0, 1e-9)


def _powers(path: Array, degree: int) -> Array:
    """(bins, degree + 1) of the place along the path, from -1 to 1."""
    middle, half = _middle(path)
    return np.power.outer((path - middle) / half, np.arange(degree + 1))


def _moved(found: Sequence[Segment], scale: Array) -> Array:
    """(signals, bins, bins) what is not known of what the arm's own motion takes."""
    motion = np.concatenate([segment.motion for segment in found])
    if not motion.shape[1]:
        return scale[:, None, None] ** 2 * _inertia(found)
    out: list[Array] = []
    for taken in motion.T:
        block = tuning.INERTIA_SHARE**2 * np.outer(taken, taken)
        out.append(block + np.diag((tuning.UNSTEADY_SHARE * taken) ** 2))
    return np.array(out)


def _inertia(found: Sequence[Segment]) -> Array:
    """(bins, bins) N² of what an unknown arm takes."""
    path = np.concatenate([segment.path for segment in found])
    acceleration = np.concatenate([segment.acceleration for segment in found])
    inertia = acceleration[:, None] * _powers(path, tuning.INERTIA_DEGREE)
    out: Array = tuning.APPARENT_MASS**2 * (inertia @ inertia.T)
    return out + np.diag((tuning.UNSTEADY * acceleration) ** 2)


def _drift(apart: Array) -> Array:
    """(n, n) N²: covariance of an Ornstein-Uhlenbeck process at times `apart`, s."""
    return tuning.DRIFT**2 * np.exp(-apart / tuning.DRIFT_TIME)


def flicker(apart: Array) -> Array:
    """(n, n): covariance of 1/f noise of density 1/f, at times `apart`, s: a sum of processes with
    time constants evenly in their logarithm (Riley, as in `estimation.load.noise`, section 3.3)."""
    times = tuning.FLICKER_TIMES
    step = float(np.log(times[1] / times[0]))
    out = np.zeros_like(apart)
    for time in times:
        out += step * np.exp(-apart / time)
    return out
