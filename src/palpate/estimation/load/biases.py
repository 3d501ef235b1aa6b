"""Covariance of signals without a load: bias, drift, noise and inertia of the arm, from bin to bin."""

from __future__ import annotations

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.load.noise import flicker
from palpate.estimation.load.segments import Weighing
from palpate.geometry.pose import Array


def covariance(weighing: Weighing, maps: Array, apart: float) -> Array:
    """(n, n) of all rows without the load: white noise, biases, inertia of the arm, and drift.

    `apart` is the share (1 sigma) of the bias that each kind of segments has of its own.
    """
    found = weighing.segments
    bins, signals = maps.shape[:2]
    variance = np.concatenate([segment.variance for segment in found])
    bias = bias_covariance(weighing, apart)
    t = np.concatenate([segment.t for segment in found])
    between = np.abs(t[:, None] - t)
    # Ornstein-Uhlenbeck process.
    drift = tuning.DRIFT**2 * np.exp(-between / tuning.DRIFT_TIME)
    moved = inertia_covariance(weighing)
    spans = weighing.spans
    out = np.zeros((signals * bins, signals * bins))
    for i, scale in enumerate(weighing.scale.tolist()):
        block = scale**2 * (bias + drift) + weighing.noise.flicker[i] * flicker(between)
        # Mean with the empty hand, N m: the scale of the bias where an end effector is wrongly configured.
        # The contrast with the load does not depend on it.
        shown = [float(segment.observed[:, i].mean()) for segment in found if not segment.loaded]
        block += (float(np.mean(shown)) if shown else 0.0) ** 2
        block += moved[i]
        if weighing.left is not None:
            block += weighing.left.covariance(spans, i)
        block += np.diag(variance[:, i] + (tuning.FLOOR * scale) ** 2)
        out[i * bins : (i + 1) * bins, i * bins : (i + 1) * bins] = block
    return out


def _each(found: Weighing, name: str) -> Array:
    """An attribute of all segments, bin after bin."""
    return np.concatenate([getattr(segment, name) for segment in found.segments])


def bias_covariance(weighing: Weighing, apart: float) -> Array:
    """(bins, bins) N²: covariance of one signal in units of its scale, without noise: constant bias; bias
    along the path, of which each kind has its own share `apart`, and each turn all; inertia and viscous
    effects of the motion; residual stiction of rests."""
    found = weighing.segments
    kinds = np.concatenate([[segment.kind] * len(segment.t) for segment in found])
    own = np.concatenate([np.full(len(s.t), i) for i, s in enumerate(found)])
    at_rest = np.concatenate([np.full(len(s.t), float(s.at_rest)) for s in found])
    turning = np.concatenate([np.full(len(s.t), s.turns) for s in found])
    speed2, path, turned = (_each(weighing, name) for name in ("speed2", "path", "turned"))
    # Place from -1 to 1 along the path; of a turn, along all turns.
    place = np.zeros(len(path))
    for rows, way in ((~turning, path), (turning, turned)):
        if rows.any():
            middle, half = _middle(way[rows])
            place[rows] = (way[rows] - middle) / half
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


def _middle(path: Array) -> tuple[float, float]:
    """m: middle of a path, and its half length."""
    low, high = float(path.min()), float(path.max())
    return (high + low) / 2.0, max((high - low) / 2.0, 1e-9)


def inertia_covariance(weighing: Weighing) -> Array:
    """(signals, bins, bins) uncertainty of the torque that moves the arm's own links."""
    motion = _each(weighing, "motion")
    if not motion.shape[1]:
        # An apparent mass at the TCP stands for unknown links, (bins, bins) N².
        path, acceleration = _each(weighing, "path"), _each(weighing, "acceleration")
        middle, half = _middle(path)
        powers = np.power.outer((path - middle) / half, np.arange(tuning.INERTIA_DEGREE + 1))
        inertia = acceleration[:, None] * powers
        force: Array = tuning.APPARENT_MASS**2 * (inertia @ inertia.T)
        force = force + np.diag((tuning.UNSTEADY * acceleration) ** 2)
        return weighing.scale[:, None, None] ** 2 * force
    out: list[Array] = []
    for taken in motion.T:
        block = tuning.INERTIA_SHARE**2 * np.outer(taken, taken)
        out.append(block + np.diag((tuning.UNSTEADY_SHARE * taken) ** 2))
    return np.array(out)
