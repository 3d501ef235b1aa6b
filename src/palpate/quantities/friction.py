"""Coulomb friction between a held object and what it is dragged along.

While the hand drags the object, the sensed wrench holds the tangential force and, as what is
missing from the object's weight, the normal force: N = (f_z with the object in the air) - f_z. Each
drag, in whichever direction, follows

    f_t = mu N + h,

h being what the arm's own friction and bias leave in the reading, partly the same in all drags
(friction turns round with the motion), partly not (bias does not). h does not depend on N, so it
shows as soon as N varies; otherwise only its prior bounds it, and the standard deviation says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.estimation.estimate import Estimate, not_identified
from palpate.estimation.windows import Load, Mask, at_rest, load_of, runs
from palpate.geometry.pose import Array
from palpate.parameter import Parameter
from palpate.trace.recording import Recording
from palpate.trace.samples import Samples, Trace

DRAG_SPEED = 0.002
"""m/s, commanded and horizontal, from which a row belongs to a drag."""

SLIDING = 0.85
"""Part of the usual quotient of forces from which the object may be sliding: before, it turns in
the fingers' grip."""

RISE_ROWS = 6
"""Rows of the rise before the breakaway through which a line is laid."""

FOLLOWING = 0.7
"""Part of the commanded speed at which the hand follows; slower, the object may have stuck
again."""

PEAK_WITHIN = 0.3
"""s after that in which the breakaway lies."""

SMOOTH = 0.02
"""s: forces are averaged over this before the breakaway is looked for."""

TRANSIENT = 0.25
"""s after breakaway in which the spring between arm and object still swings."""

DOWN = 0.006
"""m above the grasp that the hand may be while the object is on its support."""

DRIVE_BIAS = 0.3
"""N (1 sigma): residual of the arm's own joint friction in a horizontal force while the joints
slide."""

APPARENT_MASS = 5.0
"""kg, of a 7-axis arm at its TCP, horizontally: what its acceleration at breakaway takes of the
force."""

GAIN_RATIO = 0.8
"""A quotient of two forces that different joints carry: sqrt(2) times a gain uniform within its
half width."""

NORMAL_MIN = 0.5
"""N: below this the quotient of forces says nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class _Drag:
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
        rows = max(1, round(SMOOTH / float(np.median(np.diff(self.t)))))
        kernel = np.ones(rows) / rows
        smooth = (
            np.convolve(self.tangential, kernel, "same"),
            np.convolve(self.normal, kernel, "same"),
        )
        return np.where(smooth[1] > NORMAL_MIN, smooth[0] / np.maximum(smooth[1], NORMAL_MIN), 0.0)

    @property
    def breakaway(self) -> int | None:
        """Row at which the object begins to slide; None when it never does."""
        late = self.cruising & (self.t > self.t[0] + 0.5 * (self.t[-1] - self.t[0]))
        if not late.any():
            return None
        quotient = self.quotient
        begun = np.flatnonzero(quotient >= SLIDING * np.median(quotient[late]))
        if not len(begun):
            return None
        window = (self.t >= self.t[begun[0]]) & (self.t <= self.t[begun[0]] + PEAK_WITHIN)
        return int(np.argmax(np.where(window, quotient, -np.inf)))

    @property
    def steady(self) -> Mask:
        """Rows of steady sliding."""
        start = self.breakaway
        if start is None:
            return np.zeros(len(self.t), dtype=bool)
        return (
            (self.t > self.t[start] + TRANSIENT)
            & self.cruising
            & self.moving
            & (self.normal > NORMAL_MIN)
        )


def estimate_friction(trace: Trace, parameter: Parameter) -> Estimate:
    """Sliding friction of `gap.object` on its support from every drag in the trace, recorded or on
    the way back.

    The value is the dynamic coefficient; `components` holds `static` and `dynamic`, and `normal
    force` in N.
    """
    evidence = tuple(
        r
        for r in trace.recordings
        if r.context.activity == "sliding" and r.context.holding == parameter.object
    )
    load = load_of(trace, parameter.object)
    drags = _drags(trace, load)
    steady = [drag for drag in drags if drag.steady.sum() >= 10]
    if not steady:
        return not_identified(
            parameter,
            "No recording shows the held object sliding steadily along its support.",
            evidence,
        )
    dynamic, residuals, covariance = _dynamic(steady)
    static = _static(steady, residuals, float(covariance[1, 1]))
    gain = GAIN_RATIO * trace.hand.torque_gain * dynamic
    return _estimate(
        parameter,
        evidence,
        dynamic,
        float(np.hypot(np.sqrt(covariance[0, 0]), gain)),
        static,
        steady,
    )


def _drags(trace: Trace, load: Load) -> list[_Drag]:
    samples = trace.samples
    reference = _reference(samples, load)
    if reference is None or not load.grasps:
        return []
    step = np.gradient(samples.target_world_tcp[:, :3], samples.t, axis=0)
    horizontal = np.linalg.norm(step[:, :2], axis=1)
    floor = min(_height_at(samples, time) for time in load.grasps)
    low = samples.pose_world_tcp[:, 2] < floor + DOWN
    dragging = (
        load.loaded & low & (horizontal > DRAG_SPEED) & (np.abs(step[:, 2]) < 0.3 * horizontal)
    )
    return [
        _drag(samples, rows, step[:, :2], reference)
        for rows in runs(dragging)
        if rows.stop - rows.start > 20
    ]


def _height_at(samples: Samples, time: float) -> float:
    return float(
        samples.pose_world_tcp[min(int(np.searchsorted(samples.t, time)), len(samples) - 1), 2]
    )


def _reference(samples: Samples, load: Load) -> Array | None:
    """(3,) N: the force with the object hanging free: what is sensed with nothing tangential and no
    support."""
    floor = min((_height_at(samples, time) for time in load.grasps), default=np.inf)
    hanging = at_rest(samples) & load.loaded & (samples.pose_world_tcp[:, 2] > floor + 0.02)
    return samples.wrench[hanging, :3].mean(axis=0) if hanging.any() else None


def _drag(samples: Samples, rows: slice, step: Array, reference: Array) -> _Drag:
    velocity = step[rows]
    way = velocity.sum(axis=0) / np.linalg.norm(velocity.sum(axis=0))
    force = samples.wrench[rows, :3] - reference
    commanded = velocity @ way
    # Backward differences: central ones would lend the last row before the slip the jump that
    # follows it.
    acceleration = np.diff(samples.twist[:, :2] @ way, prepend=0.0)[rows] / float(
        np.median(np.diff(samples.t))
    )
    tangential = force[:, :2] @ way - APPARENT_MASS * acceleration
    return _Drag(
        samples.t[rows],
        tangential,
        -force[:, 2],
        commanded > 0.95 * float(np.median(commanded)),
        samples.twist[rows, :2] @ way > FOLLOWING * commanded,
    )


def _dynamic(drags: Sequence[_Drag]) -> tuple[float, Array, Array]:
    """mu_d, each drag's residual h (N), and the covariance of mu_d and the mean of h, given priors
    on h."""
    tangential = np.concatenate([d.tangential[d.steady] for d in drags])
    normal = np.concatenate([d.normal[d.steady] for d in drags])
    owner = np.repeat(np.arange(len(drags)), [int(d.steady.sum()) for d in drags])
    own = owner[:, None] == np.arange(len(drags))
    design = np.column_stack([normal, np.ones_like(normal), own]).astype(np.float64)
    prior = np.diag([0.0] + [DRIVE_BIAS**-2] * (1 + len(drags)))
    rough = float(tangential @ normal / (normal @ normal))
    spread = CORRELATION * max(float((tangential - rough * normal).std()), 1e-3) ** 2
    covariance: Array = np.linalg.inv(design.T @ design / spread + prior).astype(np.float64)
    found: Array = covariance @ (design.T @ tangential) / spread
    mean_of = np.eye(2, len(found))
    mean_of[1, 2:] = 1.0 / len(drags)
    return float(found[0]), found[1] + found[2:], mean_of @ covariance @ mean_of.T


CORRELATION = 10.0
"""Rows of a drag per independent one: stick-slip and the arm's own swing correlate over a tenth of
a second."""


def _static(
    drags: Sequence[_Drag], residuals: Array, residual_variance: float
) -> tuple[float, float] | None:
    """mu_s and its standard deviation, from the force at each breakaway."""
    peaks = (_peak(drag, float(residual)) for drag, residual in zip(drags, residuals, strict=True))
    found = [peak for peak in peaks if peak is not None]
    if not found:
        return None
    ratios, noises, normals = (np.array(column) for column in zip(*found, strict=True))
    scatter = float(ratios.std(ddof=1)) if len(ratios) > 1 else 0.0
    common = residual_variance / float(normals.mean()) ** 2
    return float(ratios.mean()), float(
        np.sqrt((np.mean(noises**2) + scatter**2) / len(ratios) + common)
    )


def _peak(drag: _Drag, residual: float) -> tuple[float, float, float] | None:
    """mu_s of one breakaway, its noise, and the normal force."""
    k = drag.breakaway
    if k is None:
        return None
    near = np.flatnonzero(np.abs(drag.t - drag.t[k]) <= SMOOTH)
    top = int(near[np.argmax(drag.tangential[near] / np.maximum(drag.normal[near], NORMAL_MIN))])
    rise = slice(max(top - RISE_ROWS + 1, 0), top + 1)
    normal = float(drag.normal[rise].mean())
    noise = float(np.diff(drag.tangential[drag.steady]).std()) / np.sqrt(2.0)
    return (_last(drag.tangential[rise]) - residual) / normal, noise / normal, normal


def _last(y: Array) -> float:
    """The end of the line through `y`: a force that rises until it breaks away is greatest
    there."""
    if len(y) < 3:
        return float(y[-1])
    return float(np.polyfit(np.arange(len(y)) - (len(y) - 1), y, 1)[1])


def _estimate(
    parameter: Parameter,
    evidence: tuple[Recording, ...],
    dynamic: float,
    std: float,
    static: tuple[float, float] | None,
    drags: Sequence[_Drag],
) -> Estimate:
    normal = np.concatenate([d.normal[d.steady] for d in drags])
    components = {
        "dynamic": (dynamic, std),
        "normal force": (float(normal.mean()), float(normal.std())),
    }
    if static is not None:
        components["static"] = static
    method = (
        f"Tangential over normal force in {len(drags)} drag{'s' * (len(drags) > 1)} under "
        f"{normal.min():.1f} to {normal.max():.1f} N, both measured against the object hanging free; "
        "static at breakaway, dynamic while sliding steadily."
    )
    return Estimate(
        parameter,
        (dynamic,),
        (std,),
        ((max(dynamic - 1.96 * std, 0.0), dynamic + 1.96 * std),),
        method,
        evidence,
        "identified" if dynamic > 2.0 * std else "not identified",
        components,
    )
