"""From a wrench that is never zero to the load of a held object.

The sensed wrench is load + bias, and the bias depends on where the arm is, which way its joints
slide, how it came to rest, and on time. All of that is the same with and without the object on the
same path in the same direction, so the load is a contrast: this module finds the matched rests and
passes and solves the small mixed linear model

    y_ij = L_i F (1 + a_ij / g) + M a_ij + c_kind(s_ij) + b (t_i - t0) + e_i + n_ij

for F. i counts segments (a rest, or a pass along the path), j the bins along a pass. L_i tells
loaded segments, a is the vertical acceleration, M the arm's apparent mass, c the bias of a kind of
segment (a direction of travel, a way of coming to rest) as a cubic along the path, b drift. The
noise n is known from the samples; the scatter e between segments is not: its size is integrated out
on a grid, which gives the result the tails of few groups.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from palpate.estimation.windows import (
    Load,
    Path,
    at_rest,
    lift_path,
    load_of,
    mean_pose,
    near,
    runs,
)
from palpate.geometry.pose import Array
from palpate.trace.recording import Hand, Recording
from palpate.trace.samples import Samples, Trace

FORCE_BIAS = 0.5
"""N (1 sigma): bias of an unreferenced force; Franka states 0.8 N relative accuracy."""

TORQUE_LEVER = 0.3
"""m: what turns the force figures here into moments about the TCP (typical lever of the arm's wrist
joints)."""

KIND_BIAS = 0.3
"""N (1 sigma): how far the bias of one kind of segment lies from the common one (friction
hysteresis)."""

PASS_SCATTER = 0.003
"""N: prior scale of the scatter between passes; joints that slide hold no stick residual."""

DRIFT = 0.001
"""N/s (1 sigma)."""

APPARENT_MASS = (6.0, 3.0)
"""kg, mean and 1 sigma: apparent vertical mass of a 7-axis arm at its TCP."""

CENTRIFUGAL = 8.0
"""N s^2/m^2 (1 sigma): how much two passes differ whose squared speeds differ; equal motions
compare best."""

SAME_MOTION = 0.25
"""m/s^2, root mean square along the path: passes whose accelerations differ by more are not
compared."""

BLOCK = 0.1
"""s: samples are averaged over blocks of this length before their scatter is taken, so correlation
counts."""

TREND = 1
"""Degree of the trend in time that is taken out of a rest before its scatter is taken."""

FLOOR = 1e-4
"""N: noise that is always assumed."""

DEGREE = 3
"""Of the polynomial along the path that the bias of one direction of travel follows."""

MIN_ROWS = 5
"""Rows that make a rest."""

ARRIVAL = 0.02
"""m: the last stretch before a rest, whose direction tells how the joints' friction was left."""

PASS_SPEED = 0.01
"""m/s along the path from which the joints certainly slide."""

CORRELATED_BINS = 3.0
"""What the model of a pass leaves out is the same in about so many neighbouring bins."""

BINS = 10
"""Bins along the path, so that all passes are compared at the same configurations."""


@dataclass(frozen=True, slots=True, eq=False)
class Segment:
    """A rest, or a pass in k bins along the path.

    Attributes:
        kind: `up`, `down` (passes) or `rest ...` with how the arm came to rest.
        loaded: with the object in the hand.
        t: mean time, s. start, end: s.
        path: (k,) position along the path, -1 to 1.
        acceleration: (k,) vertical, m/s^2. speed2: (k,) m^2/s^2, squared speed.
        mean, variance: (k, 6) of the wrench.
    """

    kind: str
    loaded: bool
    t: float
    start: float
    end: float
    path: Array
    acceleration: Array
    speed2: Array
    mean: Array
    variance: Array

    @property
    def at_rest(self) -> bool:
        return self.kind.startswith("rest")


@dataclass(frozen=True, slots=True, eq=False)
class Contrast:
    """A load's component (N or N m) with its posterior standard deviation and central 95 %
    interval."""

    value: float
    std: float
    ci95: tuple[float, float]


def segments(trace: Trace, recording: Recording) -> list[Segment]:
    """All rests and passes that tell about the load of `recording`, with and without it."""
    load = load_of(trace, recording.context.holding)
    path = lift_path(trace, recording, load)
    passes = _passes(trace, load, path) if path else []
    found = _measure(trace.samples, _rests(trace, recording, load, path), passes, path)
    return [s for s in found if s.at_rest or any(_comparable(s, other) for other in found)]


def _comparable(one: Segment, other: Segment) -> bool:
    """Whether two passes, one with the load and one without, were the same motion: else the arm's
    own inertia, which is far larger than a load's, does not cancel."""
    if one.kind != other.kind or one.loaded == other.loaded:
        return False
    apart = one.acceleration - np.interp(one.path, other.path, other.acceleration)
    return float(np.sqrt(np.mean(apart**2))) < SAME_MOTION


def referenced(found: Iterable[Segment]) -> bool:
    """Whether some kind of segment was seen both with and without the load."""
    found = list(found)
    return bool({s.kind for s in found if s.loaded} & {s.kind for s in found if not s.loaded})


def fit_load(found: Sequence[Segment], axis: int, gravity: float, hand: Hand) -> Contrast:
    """The load's wrench component `axis` (0..5) from segments.

    Raises:
        ValueError: there is no loaded segment.
    """
    if not any(s.loaded for s in found):
        raise ValueError("no recording with the load on the hand")
    scale = 1.0 if axis < 3 else TORQUE_LEVER
    apparent = APPARENT_MASS[0] if axis == 2 else 0.0
    design, prior = _design(found, axis, gravity, scale)
    readings: list[Array] = [s.mean[:, axis] - apparent * s.acceleration for s in found]
    y = np.concatenate(readings) / scale
    variances: list[Array] = [s.variance[:, axis] for s in found]
    noise = np.concatenate(variances) / scale**2 + FLOOR**2

    noise = noise + _misfit(
        found, design, np.concatenate([prior, np.full(len(found), 0.02)]), y, noise
    )

    unequal = _unequal(found)

    def scatter(rest: float, moving: float) -> list[float]:
        return [
            float(np.hypot(rest if s.at_rest else moving, extra))
            for s, extra in zip(found, unequal, strict=True)
        ]

    fits = [
        (
            *_solve(design, np.array([*prior, *scatter(rest, moving)]), y, noise),
            _half_cauchy(rest, hand.force_repeatability / 2) + _half_cauchy(moving, PASS_SCATTER),
        )
        for rest, moving in product(_REST_GRID, _PASS_GRID)
    ]
    value, variance, evidence, log_prior = (np.array(column) for column in zip(*fits, strict=True))
    log_weight = evidence + log_prior
    weight = np.exp(log_weight - log_weight.max())
    return _mixture(value * scale, np.sqrt(variance) * scale, weight / weight.sum())


_REST_GRID, _PASS_GRID = np.geomspace(0.02, 0.8, 12), np.geomspace(0.001, 0.1, 10)
"""N: scatter that is integrated over; uniform in its logarithm, hence the Jacobian in
`_half_cauchy`."""


def _half_cauchy(sigma: float, scale: float) -> float:
    return float(np.log(sigma) - np.log1p((sigma / scale) ** 2))


def _design(
    found: Sequence[Segment], axis: int, gravity: float, scale: float
) -> tuple[Array, Array]:
    """Columns, and the prior standard deviations of all but the last group.

    Load, apparent mass, common bias, drift; a polynomial along the path for each kind; one per
    segment.
    """
    kinds = sorted({s.kind for s in found})
    t0 = float(np.mean([s.t for s in found]))
    rows = [
        [
            s.loaded * (1.0 + a / gravity),
            a,
            1.0,
            s.t - t0,
            *((s.kind == kind) * x**power for kind in kinds for power in range(DEGREE + 1)),
            *(s is other for other in found),
        ]
        for s in found
        for x, a in zip(s.path, s.acceleration, strict=True)
    ]
    inertia = APPARENT_MASS[1] * (1.0 if axis == 2 else 0.5)
    prior = [1e3 / scale, inertia, FORCE_BIAS, DRIFT, *([KIND_BIAS] * (len(kinds) * (DEGREE + 1)))]
    return np.array(rows, dtype=float), np.array(prior)


def _solve(design: Array, prior: Array, y: Array, variance: Array) -> tuple[float, float, float]:
    """Posterior mean and variance of the first coefficient, and the log evidence, all Gaussian."""
    information = (design.T / variance) @ design + np.diag(prior**-2)
    projected = design.T @ (y / variance)
    covariance = np.linalg.inv(information)
    mean = covariance @ projected
    misfit = float(y @ (y / variance) - projected @ mean)
    log_det = float(2.0 * np.log(prior).sum() + np.linalg.slogdet(information)[1])
    return float(mean[0]), float(covariance[0, 0]), -0.5 * (misfit + log_det)


def _unequal(found: Sequence[Segment]) -> list[float]:
    """N: scatter of each pass for moving at another speed than the others of its kind."""
    kinds = {s.kind for s in found}
    speed2 = {
        kind: np.mean([float(s.speed2.mean()) for s in found if s.kind == kind]) for kind in kinds
    }
    return [
        0.0 if s.at_rest else CENTRIFUGAL * abs(float(s.speed2.mean() - speed2[s.kind]))
        for s in found
    ]


def _misfit(found: Sequence[Segment], design: Array, prior: Array, y: Array, noise: Array) -> Array:
    """Variance to add to each row: what the model leaves of each pass beyond its noise, as
    correlated over bins."""
    information = (design.T / noise) @ design + np.diag(prior**-2)
    residual = y - design @ np.linalg.solve(information, design.T @ (y / noise))
    out = np.zeros_like(y)
    first = 0
    for segment in found:
        rows = slice(first, first + len(segment.path))
        first = rows.stop
        if not segment.at_rest:
            out[rows] = CORRELATED_BINS * max(
                0.0, float((residual[rows] ** 2 - noise[rows]).mean())
            )
    return out


def _mixture(means: Array, stds: Array, weights: Array) -> Contrast:
    """Moments and quantiles of a mixture of normals."""
    mean = float(weights @ means)
    std = float(np.sqrt(weights @ (stds**2 + (means - mean) ** 2)))

    parts = [
        (w, NormalDist(m, s)) for w, m, s in zip(weights, means, stds, strict=True) if w > 1e-6
    ]
    return Contrast(mean, std, (_quantile(parts, 0.025), _quantile(parts, 0.975)))


def _quantile(parts: Sequence[tuple[float, NormalDist]], p: float) -> float:
    """The point below which the mixture has `p` of its mass, by bisection."""
    low = min(part.mean - 12 * part.stdev for _, part in parts)
    high = max(part.mean + 12 * part.stdev for _, part in parts)
    for _ in range(60):
        middle = (low + high) / 2
        below = sum(w * part.cdf(middle) for w, part in parts)
        low, high = (middle, high) if below < p else (low, middle)
    return (low + high) / 2


@dataclass(frozen=True, slots=True)
class _Cut:
    """Rows of one rest or pass."""

    kind: str
    loaded: bool
    rows: slice


def _rests(trace: Trace, recording: Recording, load: Load, path: Path | None) -> list[_Cut]:
    samples = trace.samples
    measured = (samples.t >= recording.start) & (samples.t <= recording.end)
    here = (at_rest(samples) & near(samples, mean_pose(trace.of(recording)))) | measured
    return [
        _Cut(f"rest {_arrival(samples, rows.start, path)}", loaded, rows)
        for loaded, mask in ((True, load.loaded), (False, load.empty))
        for rows in runs(here & mask)
        if rows.stop - rows.start >= MIN_ROWS
    ]


def _arrival(samples: Samples, row: int, path: Path | None) -> str:
    """How the arm came to rest at `row`: `up` or `down` the path, or `beside` it."""
    if path is None:
        return "beside"
    moved = samples.target_world_tcp[row, :3] - samples.target_world_tcp[: row + 1, :3]
    far = np.flatnonzero(np.linalg.norm(moved, axis=1) > ARRIVAL)
    along = float(moved[far[-1]] @ path.axis) / ARRIVAL if len(far) else 0.0
    return "up" if along > 0.7 else "down" if along < -0.7 else "beside"


def _passes(trace: Trace, load: Load, path: Path) -> list[_Cut]:
    samples = trace.samples
    progress = path.progress(samples)
    speed = np.gradient(progress, samples.t)
    inside = path.inside(samples)
    return [
        _Cut(kind, loaded, rows)
        for kind, way in (("up", speed > PASS_SPEED), ("down", speed < -PASS_SPEED))
        for loaded, mask in ((True, load.loaded), (False, load.empty))
        for rows in runs(inside & way & mask)
        if np.ptp(progress[rows]) > 0.4 * path.length
    ]


def _measure(
    samples: Samples, rests: Sequence[_Cut], passes: Sequence[_Cut], path: Path | None
) -> list[Segment]:
    density = _noise_density(samples, rests)
    found = [_segment(samples, cut, np.zeros(1), [cut.rows], density) for cut in rests]
    if path is None or not passes:
        return found
    progress = path.progress(samples)
    low = max(float(progress[cut.rows].min()) for cut in passes)
    high = min(float(progress[cut.rows].max()) for cut in passes)
    edges = np.linspace(low, high, BINS + 1)
    for cut in passes:
        bins = np.digitize(progress, edges) - 1
        rows = np.arange(len(samples))[cut.rows]
        filled = [k for k in range(BINS) if np.any(bins[rows] == k)]
        centres = 2.0 * (np.array(filled) + 0.5) / BINS - 1.0
        found.append(
            _segment(samples, cut, centres, [rows[bins[rows] == k] for k in filled], density)
        )
    return found


def _segment(
    samples: Samples,
    cut: _Cut,
    path: Array,
    bins: Sequence[NDArray[np.intp] | slice],
    density: Array,
) -> Segment:
    acceleration = np.gradient(samples.twist[:, 2], samples.t)
    speed2 = (samples.twist[:, :3] ** 2).sum(axis=1)
    t = samples.t[cut.rows]
    return Segment(
        cut.kind,
        cut.loaded,
        float(t.mean()),
        float(t[0]),
        float(t[-1]),
        path,
        np.array([acceleration[rows].mean() for rows in bins]),
        np.array([speed2[rows].mean() for rows in bins]),
        np.array([samples.wrench[rows].mean(axis=0) for rows in bins]),
        np.array([density / len(samples.t[rows]) for rows in bins]),
    )


def _noise_density(samples: Samples, cuts: Sequence[_Cut]) -> Array:
    """(6,) variance that the mean of n rows has, times n: from means over blocks of rests, trend
    removed."""
    pooled: Array = np.zeros(6)
    freedom = 0
    for cut in cuts:
        y, t = samples.wrench[cut.rows], samples.t[cut.rows]
        size = max(1, round(BLOCK * (len(t) - 1) / max(float(t[-1] - t[0]), 1e-9)))
        count = len(t) // size
        if count <= TREND + 1:
            continue
        blocks = y[: count * size].reshape(count, size, 6).mean(axis=1)
        basis = np.vander(np.linspace(-1.0, 1.0, count), TREND + 1)
        residual: Array = blocks - basis @ (np.linalg.pinv(basis) @ blocks)
        pooled = pooled + size * (residual**2).sum(axis=0)
        freedom += count - TREND - 1
    return pooled / freedom if freedom else np.full(6, 0.01)
