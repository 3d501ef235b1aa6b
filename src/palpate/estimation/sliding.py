"""The friction in drags of a held object along its support.

A row of drag i, at the place x of the hand along the line that it goes on, follows

    f_t = (mu + w·θ) N + h + h_i + s (b + g x + q x²)

    mu          friction, which is sought; N is the normal force
    w, θ        direction of the drag, and tilt of the support
    h, h_i      what the arm leaves in the reading, along a line whichever way, and in one drag
    s           1 or -1: one way along the line or the other
    b, g, q     a bias, and what pulls with the place: a spring, a leash, a cable

It is linear in all of them, which have normal priors but for mu (Bayesian linear regression, e.g.
Bishop, Pattern Recognition and Machine Learning, section 3.3). A normal force that rises and falls
along the line tells mu from all of them, whatever they are; where it does not, their priors are in
the standard deviation. The noise comes from the scatter within short stretches, never from the
misfit, which would let the priors outweigh the recordings; the misfit is added to the standard
deviation afterwards.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.estimation import tuning
from palpate.estimation.drag import Drag
from palpate.estimation.estimate import Shared
from palpate.estimation.gains import gain_root
from palpate.estimation.load.feeling import Feeling
from palpate.geometry.pose import Array
from palpate.trace.recording import Hand

MU, TILT_X, TILT_Y = 0, 1, 2
"""Coefficients that the normal force is multiplied by."""


@dataclass(frozen=True, slots=True, eq=False)
class Sliding:
    """What fits all drags.

    Attributes:
        coefficients: (p,) mu_d first. covariance: (p, p).
        asides: for each drag (n, p), one row for each of its own: the model without mu.
        middle: (p,) mean of them over all rows of steady sliding.
        misfit: N, root mean square of what the model leaves beyond the noise.
        disagreement, freedom: of a chi-squared test of what it leaves.
        shared: what of mu_d's error all measurements with that arm have in common.
    """

    coefficients: Array
    covariance: Array
    asides: tuple[Array, ...]
    middle: Array
    misfit: float
    disagreement: float
    freedom: int
    shared: tuple[Shared, ...]

    @property
    def friction(self) -> tuple[float, float]:
        """mu_d and its standard deviation."""
        return float(self.coefficients[MU]), float(np.sqrt(self.covariance[MU, MU]))

    @property
    def constant(self) -> tuple[float, float]:
        """N: what neither turns round with the drags nor grows with the normal force, and its
        standard deviation."""
        constant = self.middle.copy()
        constant[: TILT_Y + 1] = 0.0
        return float(constant @ self.coefficients), self._std(constant)

    @property
    def tilt(self) -> tuple[float, float]:
        """By how much mu seems to differ from its mean in the direction in which it does most, and
        the standard deviation."""
        tilt = self.coefficients[TILT_X : TILT_Y + 1]
        size = float(np.linalg.norm(tilt))
        row = np.zeros_like(self.middle)
        row[TILT_X : TILT_Y + 1] = tilt / max(size, 1e-12)
        return size, self._std(row)

    def aside(self, drag: int, rows: slice) -> tuple[float, float]:
        """N: mean over rows of a drag of what is no friction of the object, and its standard
        deviation."""
        row = self.asides[drag][rows].mean(axis=0)
        return float(row @ self.coefficients), self._std(row)

    def _std(self, row: Array) -> float:
        return float(np.sqrt(row @ self.covariance @ row))


@dataclass(frozen=True, slots=True, eq=False)
class _Line:
    """A line that drags go on: its unit direction (2,), and which way each drag goes on it by the
    drag's index, 1 or -1."""

    direction: Array
    sides: dict[int, float]


def fit_sliding(drags: Sequence[Drag], felt: Feeling, hand: Hand) -> Sliding:
    """The friction of steady sliding, as an arm feels it. What its joints' gains and friction do is
    not fitted, but in the covariance."""
    designs, prior = _designs(drags)
    force, noise = _readings(drags)
    design = _blocks(drags, designs)
    weighted = design.T / noise
    posterior = np.linalg.inv(weighted @ design + np.diag(prior**-2.0))
    found: Array = posterior @ (weighted @ force)
    squares = (force - design @ found) ** 2

    excess = max(0.0, float(np.mean(squares - noise)))
    gain = posterior @ weighted
    joints = _blocks(drags, [_joints(drag, felt, hand, float(found[MU])) for drag in drags])
    spread = tuning.CORRELATED_BLOCKS * excess * np.eye(len(force)) + joints @ joints.T
    # Within one drag, half of what an approach may be off.
    allowed = noise + (hand.force_repeatability / 2) ** 2
    asides = tuple(_without_mu(part) for part in designs)
    steady = [aside[drag.steady] for aside, drag in zip(asides, drags, strict=True)]
    return Sliding(
        found,
        (posterior + gain @ spread @ gain.T).astype(np.float64),
        asides,
        np.vstack(steady).mean(axis=0),
        float(np.sqrt(excess)),
        float((squares / allowed).sum()) / tuning.CORRELATED_BLOCKS,
        max(1, round(len(force) / tuning.CORRELATED_BLOCKS)),
        _shared(gain[MU] @ joints),
    )


def _shared(effects: Array) -> tuple[Shared, ...]:
    """What one standard deviation of each column of `_joints` does to mu_d."""
    if len(effects) == 1:
        return (Shared("gain of the joints", "arm", tuple(effects.tolist())),)
    count = len(effects) // 2
    causes = [f"{what} of joint {i + 1}" for what in ("gain", "friction") for i in range(count)]
    found = zip(causes, effects.tolist(), strict=True)
    return tuple(Shared(cause, "arm", (effect,)) for cause, effect in found)


def _designs(drags: Sequence[Drag]) -> tuple[list[Array], Array]:
    """For each drag (n, p), one row for each of its own, and the prior standard deviations (p,)."""
    lines = _lines(drags)
    places = np.vstack([drag.place[drag.steady] for drag in drags])
    middle = (places.max(axis=0) + places.min(axis=0)) / 2
    prior = [tuning.FRICTION_PRIOR, tuning.TILT, tuning.TILT]
    for _ in lines:
        prior += [tuning.FORCE_BIAS, tuning.KIND_BIAS, tuning.PULL, tuning.CURVE]
    prior += [tuning.KIND_BIAS] * len(drags)

    designs: list[Array] = []
    for i, (drag, own) in enumerate(zip(drags, np.eye(len(drags)), strict=True)):
        ones = np.ones((len(drag.t), 1))
        along = [_along(drag, line, line.sides.get(i, 0.0), middle) for line in lines]
        normal = drag.normal[:, None]
        designs.append(np.hstack([normal, normal * drag.way, *along, ones * own]))
    return designs, np.array(prior)


def _lines(drags: Sequence[Drag]) -> list[_Line]:
    found: list[_Line] = []
    for i, drag in enumerate(drags):
        for line in found:
            along = float(line.direction @ drag.way)
            if abs(along) > tuning.SAME_LINE:
                line.sides[i] = float(np.sign(along))
                break
        else:
            found.append(_Line(drag.way, {i: 1.0}))
    return found


def _along(drag: Drag, line: _Line, side: float, middle: Array) -> Array:
    """(n, 4) the line's columns in a drag that goes on it one way or the other, or not at all."""
    x = (drag.place - middle) @ line.direction
    columns = [abs(side) * np.ones_like(x), side * np.ones_like(x), side * x]
    return np.column_stack([*columns, side * (x / tuning.HALF_WAY) ** 2])


def _joints(drag: Drag, felt: Feeling, hand: Hand, mu: float) -> Array:
    """(n, k) N: what the arm's joints may leave in f_t - mu N, one column for each unknown at its
    standard deviation: gains, and friction, which turns round with the joint."""
    if felt.chain is None:
        # Not known joint by joint: both forces carry the gain of the joints that sensed them.
        return (tuning.GAIN_RATIO * hand.torque_gain * mu * drag.normal)[:, None]
    # The wrench is (J^T)^+ tau: what of a joint's torque shows in f_t - mu N.
    middle: Array = drag.q.mean(axis=0, keepdims=True)
    wrenches: Array = np.linalg.pinv(felt.maps(middle)).astype(np.float64)
    lever: Array = drag.way @ wrenches[0, :2] + mu * wrenches[0, 2]
    gains = (lever * drag.torque) @ gain_root(hand, len(lever))
    return np.column_stack([gains, tuning.JOINT_TORQUE * lever * drag.turned])


def _readings(drags: Sequence[Drag]) -> tuple[Array, Array]:
    """(m,) N: the tangential force in each block, and the variance of its noise, N²."""
    forces = _blocks(drags, [drag.tangential[:, None] for drag in drags])[:, 0]
    noises: list[float] = []
    for drag in drags:
        for block in _cut(drag):
            noises.append(drag.noise / len(block) + tuning.SLIDING_NOISE**2)
    return forces, np.array(noises)


def _blocks(drags: Sequence[Drag], columns: Sequence[Array]) -> Array:
    """(m, p) means over blocks of steady sliding, of columns (n, p) for each drag."""
    means: list[Array] = []
    for drag, values in zip(drags, columns, strict=True):
        for block in _cut(drag):
            means.append(values[block].mean(axis=0))
    return np.array(means)


def _cut(drag: Drag) -> list[NDArray[np.intp]]:
    """Rows of each block of steady sliding."""
    steady = np.flatnonzero(drag.steady)
    size = max(1, round(tuning.BLOCK / drag.period))
    return np.array_split(steady, max(1, len(steady) // size))


def _without_mu(design: Array) -> Array:
    aside = design.copy()
    aside[:, MU] = 0.0
    return aside


@dataclass(frozen=True, slots=True)
class _Peak:
    """mu_s of one breakaway, and variances: of its own, and of what breakaways have in common."""

    ratio: float
    own: float
    common: float


def static_friction(drags: Sequence[Drag], sliding: Sliding) -> tuple[float, float] | None:
    """mu_s and its standard deviation, from the force at each breakaway; None without one."""
    peaks = list(_peaks(drags, sliding))
    if not peaks:
        return None
    ratios = np.array([peak.ratio for peak in peaks])
    own = np.array([peak.own for peak in peaks])
    common = np.array([peak.common for peak in peaks])
    weight = 1.0 / (own + common)
    weight /= weight.sum()
    scatter = float(ratios.var(ddof=1)) / len(ratios) if len(ratios) > 1 else 0.0
    variance = max(float(weight**2 @ own), scatter) + float(weight @ common)
    return float(weight @ ratios), float(np.sqrt(variance))


def _peaks(drags: Sequence[Drag], sliding: Sliding) -> Iterator[_Peak]:
    for i, drag in enumerate(drags):
        peaks = [_peak(drag, rows, *sliding.aside(i, rows)) for rows in drag.parting]
        if peaks:
            yield max(peaks, key=lambda peak: peak.ratio)


def _peak(drag: Drag, rows: slice, aside: float, aside_std: float) -> _Peak:
    """The quotient of forces in `rows`; `aside` (N) is what of the force is no friction."""
    normal = max(float(drag.normal[rows].mean()), tuning.NORMAL_MIN)
    force = float(drag.tangential[rows].mean()) - aside
    inertia = tuning.HORIZONTAL_SPREAD * float(np.abs(drag.acceleration[rows]).max())
    own = drag.row_variance() / (rows.stop - rows.start)
    common = aside_std**2 + drag.turning(rows) ** 2 + inertia**2
    return _Peak(force / normal, own / normal**2, common / normal**2)
