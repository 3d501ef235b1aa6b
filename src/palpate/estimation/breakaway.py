"""Static friction: force at which a held object begins to slide.

As the hand starts to move, the tangential force rises with the strain of the grip up to the limit of static friction.
It stays there while the object creeps, and then falls to the known sliding level. Only the rows in between show the
limit. Their beginning and end are unknown, so the coefficient is averaged over all segmentations by their likelihood (a
change point model: Bishop, Pattern Recognition and Machine Learning, section 14.1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.common.pose import Array
from palpate.estimation.drags import NORMAL_MIN, Drag
from palpate.estimation.friction_fit import Sliding
from palpate.estimation.joint_causes import INERTIA_SHARE

MASS_ERROR = 0.5
"""kg (1 sigma). Smallest error of the arm's apparent mass from the end of a drag: the arm decelerates at other joint
angles than it started with. Chosen, without a source: a tenth of `HORIZONTAL_MASS`, rounded. Sensitive:
`static` std."""
HOLDING = 6
"""Rows (30 ms). Longest creep at the static coefficient before breakaway. Sensitive: `static` hardly."""
PARTING_ROWS = 7
"""Rows (35 ms) before breakaway with static hold or a linear rise of the force. The hand starts with a jerk, so the
rise is not linear for longer. Sensitive: `static` 0.5 σ."""
RISING = 0.25
"""Fraction (1 sigma) of the coefficient by which the force quotient rises per row. Sensitive: `static` hardly."""
STATIC_STEPS = 200
"""Number of static coefficients in the grid, which begins at the sliding coefficient. Sensitive: no."""
STATIC_RANGE = 2.5
"""Upper end of the grid over the sliding coefficient. Handbooks mostly list pairs of dry surfaces at 1.0 to 1.5.
Sensitive: `static` hardly."""
STICKIER = 0.3
"""Prior median of the relative excess of static over sliding friction: steel on steel 0.74 and 0.57, copper on steel
0.53 and 0.36, rubber on concrete 1.0 and 0.8 (tables of textbooks, e.g. Serway, Physics for Scientists and Engineers,
table 5.1). Sensitive: `static` hardly."""
STICKIER_FACTOR = 2.5
"""Factor (1 sigma) of the log-normal prior around `STICKIER`. Sensitive: `static` hardly."""
TURNING = 0.5
"""Relative error (1 sigma) of the reduced friction of reversing joints. The reversal distance `PRESLIDING`, in mrad,
is known to a factor of about two. Sensitive: `static` std ×0.8 at 0 for 0.4 N m of joint friction."""
STATIC_NOISE = 0.005
"""Smallest noise of a row's force quotient: the rise is not exactly linear. Sensitive: `static` hardly."""
PARTINGS_SEEN = 0.5
"""Ratio of posterior to prior standard deviation below which breakaways give a static friction. Sensitive: no."""

FLOOR = 1e-300
"""Smallest argument of a logarithm."""


@dataclass(frozen=True, slots=True, eq=False)
class Parting:
    """Likelihood of the static coefficient from one breakaway."""

    drag: int  # its number
    # (m,) relative likelihood of each tried value, without the error of other causes than friction.
    chance: Array
    # mean, variance: moments of that likelihood
    mean: float
    variance: float
    rows: slice  # rows at the limit of static friction
    normal: float  # N, mean normal force in these rows
    # N, change of joint friction between these rows and those after the joints have reversed.
    turning: float


def static_friction(drags: Sequence[Drag], sliding: Sliding) -> tuple[float, float] | None:
    """Estimate mu_s and its standard deviation from the force at each breakaway; None without evidence.

    Scatter of the breakaways beyond their standard deviations widens the result (Birge's ratio: Particle Data
    Group, Review of Particle Physics, 2024, introduction, section 5.2.2).
    """
    mu = sliding.friction[0]
    values = np.linspace(1.0, STATIC_RANGE, STATIC_STEPS) * mu
    seen = [
        parting_of(i, drag, sliding, values)
        for i, drag in enumerate(drags)
        # Without a rest before the motion, the object may have slid from the beginning.
        if drag.breakaway is not None and drag.begins >= PARTING_ROWS
    ]
    # Log-normal prior of the excess of static over sliding friction.
    ratios = values / mu
    beyond = np.maximum(ratios - 1.0, ratios[1] - 1.0)
    log_ratio = np.log(beyond / STICKIER) / np.log(STICKIER_FACTOR)
    expected: Array = np.exp(-0.5 * log_ratio**2) / beyond
    if not seen:
        return None
    # Posterior: prior times the likelihood of each breakaway, widened by the error of other causes.
    aside = np.array([_scatter_std(sliding, [parting], np.ones(1)) ** 2 for parting in seen])
    chance = expected
    for parting, variance in zip(seen, aside.tolist(), strict=True):
        chance = chance * convolve_normal(parting.chance, values, variance)
    mean, variance = _moments(chance, values)
    # Breakaways that hardly narrow the prior give no estimate.
    if variance > PARTINGS_SEEN**2 * _moments(expected, values)[1]:
        return None
    # Birge's ratio: weighted scatter of the breakaways about the posterior mean.
    own = np.array([parting.variance for parting in seen])
    means = np.array([parting.mean for parting in seen])
    weight = 1.0 / (own + aside)
    excess = float(np.mean((means - mean) ** 2 * weight))
    weight /= weight.sum()
    # Other causes are partly common to all drags: add the common variance.
    common = max(0.0, _scatter_std(sliding, seen, weight) ** 2 - float(weight**2 @ aside))
    return mean, float(np.sqrt(max(1.0, excess) * variance + common))


def _moments(chance: Array, values: Array) -> tuple[float, float]:
    """Mean and variance of values (m,) weighted by `chance`."""
    mean = float(chance @ values / chance.sum())
    return mean, float(chance @ (values - mean) ** 2 / chance.sum())


def convolve_normal(chance: Array, values: Array, variance: float) -> Array:
    """Likelihoods (m,) of `values` (m,), convolved with a normal distribution of `variance`; maximum 1."""
    spread = max(variance, (values[1] - values[0]) ** 2)
    kernel = np.exp(-0.5 * (values[:, None] - values) ** 2 / spread)
    wide: Array = (kernel / kernel.sum(axis=0)) @ chance
    return wide / wide.max()


def _scatter_std(sliding: Sliding, seen: Sequence[Parting], weight: Array) -> float:
    """Standard deviation of a weighted mean of breakaways by causes other than the object's friction."""
    each = list(zip(seen, weight.tolist(), strict=True))
    turning = sum(share * part.turning / part.normal for part, share in each)
    others = sliding.apart([(part.drag, part.rows, share / part.normal) for part, share in each])
    return float(np.hypot(others, TURNING * turning))


def parting_of(number: int, drag: Drag, sliding: Sliding, values: Array) -> Parting:
    """Likelihood of each of `values` (m,) of the static coefficient from one drag.

    `values[0]` is the sliding coefficient; `number` is the drag's number.
    """
    # Force quotient without other causes and inertia, and its noise in each row.
    mass, mass_std = apparent_mass(number, drag, sliding)
    normal = np.maximum(drag.normal, NORMAL_MIN)
    ratio = (drag.tangential - sliding.other_causes(number) - mass * drag.acceleration) / normal
    scatter = max(drag.row_variance(), drag.noise)
    noise = np.hypot(np.sqrt(scatter) / normal, STATIC_NOISE)
    # Use the rows from the visible rise to steady sliding: the hand follows soon after breakaway.
    seen = slice(drag.begins - PARTING_ROWS, drag.follows + 3 * PARTING_ROWS)
    likely = segmentation_likelihood(ratio[seen], noise[seen], values)
    # Most likely segmentation: it gives the rows at the static limit.
    falls, holds = np.unravel_index(np.argmax(likely.max(axis=2)), likely.shape[:2])
    rows = slice(seen.start + int(falls - holds), seen.start + int(falls) + 1)
    # Alternative: the breakaway came before these rows, at any value, and the object slides in all of them.
    slid = log_normal_density(ratio[seen] - values[0], noise[seen])[PARTING_ROWS:].sum()
    before = -PARTING_ROWS * np.log(2.0 * values)
    most = max(float(likely.max()), slid + before.max())
    chance: Array = np.exp(likely - most).mean(axis=(0, 1)) + np.exp(slid + before - most)
    # While the foot sticks, the object turns in the grip: between none and all of its mass moves with the hand.
    pressed = float(normal[rows].mean())
    accelerated = float(drag.acceleration[rows].mean())
    turning = drag.mass * accelerated / pressed
    # Shift the likelihood by half of that inertial force and widen it by its error.
    unsure = np.hypot(mass_std * accelerated, INERTIA_SHARE * float(drag.inertial[rows].mean()))
    wider = turning**2 / 12.0 + float(unsure / pressed) ** 2
    moved: Array = np.interp(values - turning / 2.0, values, chance)
    chance = convolve_normal(moved, values, wider)
    less = sliding.turning(number, rows, drag.steady)
    return Parting(number, chance, *_moments(chance, values), rows, pressed, less)


def segmentation_likelihood(ratio: Array, noise: Array, values: Array) -> Array:
    """Log likelihood (n, h, m) of force quotients (n,) with std `noise` under each segmentation.

    In entry (i, j, k), row i is the last before breakaway, after j + 1 rows at the k-th of `values` (m,). The
    first value is the sliding coefficient. All segmentations explain the same rows, so they are comparable.
    """
    count, mu = len(ratio), float(values[0])
    parting = breakaway_likelihood(ratio, noise, mu, values)
    # Cumulative sums from 0: the likelihood of any row range is a difference.
    each = log_normal_density(ratio[:, None] - values, noise[:, None])
    holding = np.concatenate([np.zeros_like(each[:1]), np.cumsum(each, axis=0)])
    sliding = np.concatenate(
        [np.zeros(1), np.cumsum(log_normal_density(ratio - mu, noise), axis=0)]
    )
    # Before the rise, the force may have any value: a uniform density.
    anything = -np.log(2.0 * values)
    # A segmentation: any value, linear rise, static hold, breakaway, sliding.
    found = np.full((count, HOLDING, len(values)), -np.inf)
    for i in range(PARTING_ROWS - 1, count - 2 * PARTING_ROWS):
        begun = i + 1 - PARTING_ROWS
        after = sliding[count] - sliding[i + 2]
        for j in range(HOLDING):
            part = slice(begun, i - j)
            rising = rise_likelihood(ratio[part], noise[part], values)
            held = holding[i] - holding[i - j]
            found[i, j] = anything * begun + rising + held + parting[i] + after
    return found


def breakaway_likelihood(ratio: Array, noise: Array, mu: float, values: Array) -> Array:
    """Log likelihood (n - 1, m) of two neighbouring quotients with the breakaway between them."""
    # The breakaway may be half a row earlier or later, and accelerations are means over two rows. Half of the
    # fall lies in the two rows; the first takes none, half or all of it.
    fall = values - mu
    each = [
        log_normal_density(ratio[:-1, None] - (values - part * fall), noise[:-1, None])
        + log_normal_density(ratio[1:, None] - (mu + (0.5 - part) * fall), noise[1:, None])
        for part in (0.0, 0.25, 0.5)
    ]
    likely: Array = np.logaddexp.reduce(each) - np.log(len(each))
    return likely


def rise_likelihood(ratio: Array, noise: Array, values: Array) -> Array:
    """Log likelihood (m,) of quotients that rise linearly up to each of `values`, with unknown positive slope.

    The last quotient is a whole step or half a step below the value.
    """
    from scipy.special import ndtr

    # Distance of each row below the value, in steps of the rise and in standard deviations.
    whole = np.arange(len(ratio), 0.0, -1.0)
    short = (values - ratio[:, None]) / noise[:, None]
    steep = (RISING * values) ** 2
    each: list[Array] = []
    # Integrate over the half-normal prior of the slope in closed form.
    for within in (0.0, 0.5):
        ahead = (whole - within) / noise
        known = 1.0 + steep * float(ahead @ ahead)
        slope = steep / known * (ahead @ short)
        square = (short**2).sum(axis=0) - slope * (ahead @ short)
        upwards = 2.0 * ndtr(slope / np.sqrt(steep / known))
        each.append(np.log(np.maximum(upwards, FLOOR)) - 0.5 * (square + np.log(known)))
    likely: Array = np.logaddexp.reduce(each) - np.log(len(each))
    return likely - np.log(noise * np.sqrt(2.0 * np.pi)).sum()


def log_normal_density(off: Array, noise: Array) -> Array:
    """Log density of a normal distribution of standard deviation `noise` at a deviation `off`."""
    return -0.5 * (off / noise) ** 2 - np.log(noise * np.sqrt(2.0 * np.pi))


def apparent_mass(number: int, drag: Drag, sliding: Sliding) -> tuple[float, float]:
    """Apparent mass beyond `HORIZONTAL_MASS`, kg, of an arm with unknown links along a drag, and its std.

    It is the change of force over the change of speed as the hand decelerates.
    """
    if not drag.unsure_mass:
        return 0.0, 0.0
    prior = drag.unsure_mass**-2
    # Impulse balance over the rows in which the hand decelerates.
    rows = drag.slowing
    lost = -float(drag.acceleration[rows].sum())
    if lost <= 0.0:
        return 0.0, prior**-0.5
    aside, aside_std = sliding.aside(number, rows)
    count = rows.stop - rows.start
    friction = sliding.friction[0] * float(drag.normal[rows].sum())
    excess = float(drag.tangential[rows].sum()) - friction - count * aside
    variance = (count * drag.row_variance() + (count * aside_std) ** 2) / lost**2
    # Combine the measured excess with its prior of mean 0 by inverse variances.
    known = 1.0 / max(variance, MASS_ERROR**2)
    return -excess / lost * known / (known + prior), (known + prior) ** -0.5
