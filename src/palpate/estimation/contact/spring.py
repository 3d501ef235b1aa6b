"""A surface that gives way, as a spring: the whole loading curve of a guarded descent at once.

    f = f0 + k max(z0 - z, 0) - m a - [contact] d v + s [at rest]

with the pressing force f, tip height z, its velocity v and acceleration a. f0 is what free air
feels like while the arm descends, s what the joints' friction adds once it rests, m the arm's
apparent mass, whose inertia the torque sensors feel, and d what the surface dissipates. All but z0
enter linearly, so that they are solved for at each z0, and z0 is searched for (variable
projection, Golub & Pereyra 1973).

The controller's own stiffness, though in series with the surface, is not in it: the tip's height is
measured. What gives way between the encoders and the pads' end is, as `tip_compliance`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.contact.descent import Descent, block_means
from palpate.estimation.windows import Mask
from palpate.geometry.pose import Array
from palpate.trace.recording import Hand

STIFFNESS, DAMPING = 1, 3
"""Places of k and d among the unknowns."""


@dataclass(frozen=True, slots=True)
class Onset:
    """Where something was met, as the loading curve shows it without a model.

    Attributes:
        first: m, tip height at which the force began to rise, with its standard deviation.
        bottomed: m, tip height at which something soft had been pressed through; None for none.
        secant: m/N, of the whole loading curve.
    """

    first: float
    first_std: float
    bottomed: float | None
    secant: float


@dataclass(frozen=True, slots=True, eq=False)
class Spring:
    """A surface as a spring.

    Attributes:
        compliance: m/N, of the surface alone, with its standard deviation.
        held, held_std: m/N, the same as the arm at rest shows it: how deep the tip is held below where
            the force began to rise, over the force.
        first: m, tip height at which it was met.
        misfit: what the spring leaves of the force, in means over some rows, over what chance would.
    """

    compliance: float
    compliance_std: float
    held: float
    held_std: float
    first: float
    misfit: float

    def at_most(self, sigmas: float) -> float:
        """m/N that it gives way at most, as far as so many standard deviations tell: by the whole
        curve, where what is held does not belie it. What flows is held deeper than a spring would be."""
        curve = self.compliance + sigmas * self.compliance_std
        doubt = sigmas * self.held_std
        return min(max(curve, self.held - doubt), self.held + doubt)

    def at_least(self, sigmas: float) -> float:
        """m/N, likewise."""
        curve = self.compliance - sigmas * self.compliance_std
        return max(curve, self.held - sigmas * self.held_std)


@dataclass(frozen=True, slots=True, eq=False)
class _Curve:
    """Rows of a descent, and the columns of the model that do not depend on z0.

    Attributes:
        z: (n,) m. force: (n,) N. speed, acceleration: (n,) m/s, m/s². resting: (n,) 0 to 1.
        noise: N, of a row. prior: (5,) 1 sigma of f0, k, m, d, s. believed: (5,) their means.
    """

    z: Array
    force: Array
    speed: Array
    acceleration: Array
    resting: Array
    noise: float
    prior: Array
    believed: Array

    def design(self, first: float) -> Array:
        """(n, 5): what one unit of f0, k, m, d and s does to the force."""
        depth = np.maximum(first - self.z, 0.0)
        drag = -self.speed * (depth > 0.0)
        columns = (np.ones(len(self.z)), depth, -self.acceleration, drag, self.resting)
        return np.column_stack(columns)

    def solve(self, first: float) -> tuple[Array, float]:
        """The other unknowns (5,) for a height of the first contact, and the sum of squares."""
        design = self.design(first)
        found, squares = self._least_squares(design)
        if found[DAMPING] >= 0.0:
            return found, squares
        design[:, DAMPING] = 0.0  # nothing that is pressed drives the hand on
        return self._least_squares(design)

    def _least_squares(self, design: Array) -> tuple[Array, float]:
        precision = np.diag(self.prior**-2.0)
        normal = design.T @ design / self.noise**2 + precision
        right = design.T @ self.force / self.noise**2 + precision @ self.believed
        found = np.linalg.solve(normal, right).astype(np.float64)
        misfit = (self.force - design @ found) / self.noise
        off = (found - self.believed) / self.prior
        return found, float(misfit @ misfit + off @ off)

    def variance(self, found: Array, first: float) -> float:
        """Of k, with z0 unknown as well."""
        design = self.design(first)
        edge = found[STIFFNESS] * (design[:, STIFFNESS] > 0.0)
        full = np.column_stack([design, edge]) / self.noise
        precision = np.diag([*self.prior**-2.0, 0.0])
        # The noise is that of rows, of which some tell the same.
        normal = full.T @ full / tuning.ALIKE + precision
        return float(np.linalg.inv(normal)[STIFFNESS, STIFFNESS])


def fit_spring(descent: Descent, onset: Onset, hand: Hand) -> Spring:
    """The spring that a descent pressed on, above whatever stiff it may have met below.

    The standard deviation holds the fit's, and so what the joints' friction lets go of as the arm stops;
    the gain of the joints' sensors; how the force changes and wanders with the place, in free air and so
    on the way through; the stretch of a row, within which the first contact is not seen; and what is not
    known of the pads.
    """
    curve = _curve(descent, onset, hand)
    first = _first(descent, onset, curve)
    found, _ = curve.solve(first)
    stiffness = max(float(found[STIFFNESS]), tuning.WEAKEST)
    relative = np.sqrt(curve.variance(found, first)) / stiffness
    gain = tuning.GAIN_RATIO * hand.torque_gain
    total = 1.0 / stiffness
    row = float(np.abs(np.diff(descent.z))[: descent.onset + 1].max(initial=0.0))
    unseen = row / np.sqrt(12.0) / descent.full
    # What free air does on the way down to the contact, it may do otherwise on the way through, and
    # what joints rub with is another force in another posture.
    slopes = (tuning.FREE_SLOPE_STD, descent.slope / 2, descent.set_out[2] / tuning.POSTURE)
    slope = np.linalg.norm(slopes) / stiffness
    shares = total * np.array([relative, gain, slope, descent.wander[2] / descent.full])
    std = np.linalg.norm([*shares, unseen, hand.tip_compliance_std])
    left = curve.force - curve.design(first) @ found
    at_rest = np.array([onset.first_std, descent.friction * onset.secant]) / descent.full
    return Spring(
        total - hand.tip_compliance,
        float(std),
        onset.secant - hand.tip_compliance,
        float(np.linalg.norm([*at_rest, hand.tip_compliance_std])),
        first,
        _misfit(left, curve.noise, float(np.hypot(descent.friction, hand.force_resolution))),
    )


def _misfit(left: Array, noise: float, friction: float) -> float:
    """Root mean square of means over some rows, over what chance and the joints' friction make of
    them."""
    chance = np.hypot(noise * np.sqrt(tuning.ALIKE / tuning.BLOCK_ROWS), friction)
    return float(np.sqrt(np.mean(block_means(left) ** 2)) / chance)


def _curve(descent: Descent, onset: Onset, hand: Hand) -> _Curve:
    noise = float(np.hypot(descent.noise, hand.force_resolution))
    samples, rows = descent.samples, _rows(descent, onset, noise)
    speed = samples.twist[:, 2]
    window = np.full(tuning.CURVE_ROWS, 1.0 / tuning.CURVE_ROWS)
    acceleration = np.convolve(np.gradient(speed, samples.t), window, mode="same")
    contact = np.arange(len(samples)) > descent.onset
    resting = contact * np.clip(1.0 - np.abs(speed) / tuning.RESTING_SPEED, 0.0, 1.0)
    apparent, spread = tuning.ARM_MASS
    stick = float(np.hypot(hand.force_repeatability, descent.set_out[2]))
    dissipated = 2.0 * (tuning.DISSIPATING_MASS / max(onset.secant, tuning.UNSEEN)) ** 0.5
    return _Curve(
        descent.z[rows],
        descent.force[rows],
        speed[rows],
        acceleration[rows],
        resting[rows],
        noise=noise,
        prior=np.array([tuning.FORCE_BIAS, tuning.STIFFEST, spread, dissipated, stick]),
        believed=np.array([0.0, 0.0, apparent, 0.0, 0.0]),
    )


def _rows(descent: Descent, onset: Onset, noise: float) -> Mask:
    """From when the arm has set out to the end, without wild samples; without what is stiff below
    something soft; and without what comes after the greatest force of a probe that was eased, for the
    joints' friction turns round there."""
    samples = descent.samples
    rows = samples.t > descent.leaf.start + tuning.SWING
    rows &= np.abs(descent.force - descent.smooth) < tuning.WILD * noise
    told = samples.target_world_tcp[:, 2]
    if told[-1] - told.min() > tuning.EASED:
        rows &= np.arange(len(rows)) <= int(np.argmax(descent.smooth))
    if onset.bottomed is None:
        return rows
    return rows & (descent.z > onset.bottomed)


def _first(descent: Descent, onset: Onset, curve: _Curve) -> float:
    """m: the height of the first contact that leaves least of the force."""
    held = descent.held
    depth = max(onset.first - held, tuning.UNSEEN)
    low, high = held, min(onset.first + max(depth / 2, tuning.SOFT), float(descent.z.max()))
    best = onset.first
    for candidates in tuning.SEARCHES:
        heights = np.linspace(low, high, candidates)
        sums = [curve.solve(float(height))[1] for height in heights]
        best, step = float(heights[int(np.argmin(sums))]), float(heights[1] - heights[0])
        low, high = best - step, best + step
    return best
