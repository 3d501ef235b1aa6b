"""Drags of a held object along its support, and the friction in them.

While the hand drags the object, the sensed wrench holds the tangential force and, as what is
missing from the object's weight, the normal force: N = (f_z with the object in the air) - f_z. Each
drag, in whichever direction, follows

    f_t = mu N + h,

h being what the arm's own friction and bias leave in the reading, partly the same in all drags
(friction turns round with the motion), partly not (bias does not). h does not depend on N, so it
shows as soon as N varies; otherwise only its prior bounds it, and the standard deviation says so.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.windows import Load, Mask, at_rest, load_of, row_at, runs
from palpate.geometry.pose import Array
from palpate.trace.samples import Samples, Trace


@dataclass(frozen=True, slots=True, eq=False)
class Drag:
    """One drag, row by row.

    Attributes:
        t: s. tangential: N, along the drag, the arm's inertia taken off. normal: N.
        cruising: the motion is commanded at its full speed. moving: the hand follows it.
    """

    t: Array
    tangential: Array
    normal: Array
    cruising: Mask
    moving: Mask

    @property
    def quotient(self) -> Array:
        """(n,) tangential over normal force, smoothed."""
        rows = max(1, round(tuning.SMOOTH / float(np.median(np.diff(self.t)))))
        kernel = np.ones(rows) / rows
        tangential = np.convolve(self.tangential, kernel, "same")
        normal = np.convolve(self.normal, kernel, "same")
        pressed = normal > tuning.NORMAL_MIN
        return np.where(pressed, tangential / np.maximum(normal, tuning.NORMAL_MIN), 0.0)

    @property
    def breakaway(self) -> int | None:
        """Row at which the object begins to slide; None when it never does.

        The quotient of forces rises while the object sticks, peaks as it breaks away, and falls to
        the level of sliding, which the later half of the drag shows.
        """
        late = self.cruising & (self.t > self.t[0] + tuning.LATE * (self.t[-1] - self.t[0]))
        if not late.any():
            return None
        quotient = self.quotient
        begun = np.flatnonzero(quotient >= tuning.SLIDING * np.median(quotient[late]))
        if not len(begun):
            return None
        start = self.t[begun[0]]
        window = (self.t >= start) & (self.t <= start + tuning.PEAK_WITHIN)
        return int(np.argmax(np.where(window, quotient, -np.inf)))

    @property
    def steady(self) -> Mask:
        """Rows of steady sliding."""
        start = self.breakaway
        if start is None:
            return np.zeros(len(self.t), dtype=bool)
        swung_out = self.t > self.t[start] + tuning.TRANSIENT
        return swung_out & self.cruising & self.moving & (self.normal > tuning.NORMAL_MIN)


@dataclass(frozen=True, slots=True, eq=False)
class Dynamic:
    """The friction of steady sliding.

    Attributes:
        value, std: mu_d.
        residuals: N, h of each drag. common_variance: N², of their mean.
    """

    value: float
    std: float
    residuals: Array
    common_variance: float


@dataclass(frozen=True, slots=True)
class _Peak:
    """mu_s of one breakaway, its noise, and the normal force, N."""

    ratio: float
    noise: float
    normal: float


def steady_drags(trace: Trace, name: str) -> list[Drag]:
    """All drags of the object `name` in which it slid steadily for long enough."""
    drags = _drags(trace, load_of(trace, name))
    return [drag for drag in drags if drag.steady.sum() >= tuning.STEADY_ROWS]


def _drags(trace: Trace, load: Load) -> Iterator[Drag]:
    """Rows where the loaded hand is told to move horizontally, as low as it was at the grasp."""
    samples = trace.samples
    if not load.grasps:
        return
    floor = min(_height_at(samples, time) for time in load.grasps)
    free = _hanging_free(samples, load, floor)
    if free is None:
        return
    step = np.gradient(samples.target_world_tcp[:, :3], samples.t, axis=0)
    horizontal = np.linalg.norm(step[:, :2], axis=1)
    level = np.abs(step[:, 2]) < tuning.DRAG_SLOPE * horizontal
    low = samples.pose_world_tcp[:, 2] < floor + tuning.DOWN
    for rows in runs(load.loaded & low & (horizontal > tuning.DRAG_SPEED) & level):
        if rows.stop - rows.start > tuning.DRAG_ROWS:
            yield _drag(samples, rows, step[:, :2], free)


def _height_at(samples: Samples, time: float) -> float:
    return float(samples.pose_world_tcp[row_at(samples, time), 2])


def _hanging_free(samples: Samples, load: Load, floor: float) -> Array | None:
    """(3,) N: the force with the object hanging free: what is sensed with nothing tangential and no
    support."""
    high = samples.pose_world_tcp[:, 2] > floor + tuning.HANGING
    hanging = at_rest(samples) & load.loaded & high
    if not hanging.any():
        return None
    return samples.wrench[hanging, :3].mean(axis=0)


def _drag(samples: Samples, rows: slice, step: Array, free: Array) -> Drag:
    """The drag in `rows`; `step` is the commanded horizontal velocity, `free` the force without
    support."""
    velocity = step[rows]
    way = velocity.sum(axis=0) / np.linalg.norm(velocity.sum(axis=0))
    force = samples.wrench[rows, :3] - free
    commanded = velocity @ way
    # Backward differences: central ones would lend the last row before the slip the jump that
    # follows it.
    gained = np.diff(samples.twist[:, :2] @ way, prepend=0.0)[rows]
    acceleration = gained / float(np.median(np.diff(samples.t)))
    return Drag(
        samples.t[rows],
        force[:, :2] @ way - tuning.HORIZONTAL_MASS * acceleration,
        -force[:, 2],
        commanded > tuning.CRUISE * float(np.median(commanded)),
        samples.twist[rows, :2] @ way > tuning.FOLLOWING * commanded,
    )


def dynamic_friction(drags: Sequence[Drag]) -> Dynamic:
    """mu_d and each drag's residual h, given priors on h.

    Bayesian linear regression of f_t on N (nothing known of mu), a common h and each drag's own h
    (normal, `tuning.DRIVE_BIAS`): posterior covariance (XᵀX / s² + P)⁻¹, s² being the scatter of a
    row times how many rows there are to an independent one.
    """
    tangential = np.concatenate([drag.tangential[drag.steady] for drag in drags])
    normal = np.concatenate([drag.normal[drag.steady] for drag in drags])
    owner = np.repeat(np.arange(len(drags)), [int(drag.steady.sum()) for drag in drags])
    own = owner[:, None] == np.arange(len(drags))
    design = np.column_stack([normal, np.ones_like(normal), own]).astype(np.float64)
    prior = np.diag([0.0] + [tuning.DRIVE_BIAS**-2] * (1 + len(drags)))
    rough = float(tangential @ normal / (normal @ normal))
    scatter = max(float((tangential - rough * normal).std()), 1e-3)
    spread = tuning.CORRELATION * scatter**2
    covariance: Array = np.linalg.inv(design.T @ design / spread + prior).astype(np.float64)
    found: Array = covariance @ (design.T @ tangential) / spread
    # Two numbers of the posterior are wanted: mu, and the mean of all h.
    mean_of = np.eye(2, len(found))
    mean_of[1, 2:] = 1.0 / len(drags)
    variance = mean_of @ covariance @ mean_of.T
    return Dynamic(
        float(found[0]),
        float(np.sqrt(variance[0, 0])),
        found[1] + found[2:],
        float(variance[1, 1]),
    )


def static_friction(drags: Sequence[Drag], dynamic: Dynamic) -> tuple[float, float] | None:
    """mu_s and its standard deviation, from the force at each breakaway; None without one."""
    found: list[_Peak] = []
    for drag, residual in zip(drags, dynamic.residuals.tolist(), strict=True):
        peak = _peak(drag, residual)
        if peak is not None:
            found.append(peak)
    if not found:
        return None
    ratios = np.array([peak.ratio for peak in found])
    noises = np.array([peak.noise for peak in found])
    normals = np.array([peak.normal for peak in found])
    scatter = float(ratios.std(ddof=1)) if len(ratios) > 1 else 0.0
    # The breakaways' own errors average out; what the drags have in common does not.
    common = dynamic.common_variance / float(normals.mean()) ** 2
    variance = (np.mean(noises**2) + scatter**2) / len(ratios) + common
    return float(ratios.mean()), float(np.sqrt(variance))


def _peak(drag: Drag, residual: float) -> _Peak | None:
    row = drag.breakaway
    if row is None:
        return None
    near = np.flatnonzero(np.abs(drag.t - drag.t[row]) <= tuning.SMOOTH)
    quotient = drag.tangential[near] / np.maximum(drag.normal[near], tuning.NORMAL_MIN)
    top = int(near[np.argmax(quotient)])
    rise = slice(max(top - tuning.RISE_ROWS + 1, 0), top + 1)
    normal = float(drag.normal[rise].mean())
    noise = float(np.diff(drag.tangential[drag.steady]).std()) / np.sqrt(2.0)
    return _Peak((_last(drag.tangential[rise]) - residual) / normal, noise / normal, normal)


def _last(y: Array) -> float:
    """The end of the line through `y`: a force that rises until it breaks away is greatest
    there."""
    if len(y) < 3:
        return float(y[-1])
    return float(np.polyfit(np.arange(len(y)) - (len(y) - 1), y, 1)[1])
