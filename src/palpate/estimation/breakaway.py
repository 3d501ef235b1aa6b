"""Static friction: force at which a held object begins to slide.

As the hand sets out, the force along the support rises with the strain of the grip up to the limit of
sticking. It stays there as long as the object creeps, and then falls to the known level of sliding. Only the
rows between show the limit; their beginning and end are unknown, so the coefficient is averaged over all
segmentations by their likelihood (a change point model, e.g. Bishop, Pattern Recognition and Machine Learning,
section 14.1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from math import erfc, sqrt

import numpy as np

from palpate.common.pose import Array
from palpate.estimation.drags import NORMAL_MIN, Drag
from palpate.estimation.friction_fit import Sliding
from palpate.estimation.load_causes import INERTIA_SHARE

MASS_ERROR = 0.5
"""kg (1 sigma) at least, of what the end of a drag shows of the arm's mass: it slows down along other joint angles
than it set out with. Chosen, without a source: a tenth of `HORIZONTAL_MASS`, rounded. Sensitive: `static` std."""
HOLDING = 6
"""rows, 30 ms, for which an object holds at the coefficient of sticking and creeps before it lets go, at most.
Sensitive: `static` hardly."""
PARTING_ROWS = 7
"""rows, 35 ms, before it lets go, in which an object holds or the force rises to that in a straight line: the hand
sets out with a jerk, so that for longer it does not. Sensitive: `static` 0.5 σ."""
RISING = 0.25
"""part (1 sigma) of the coefficient by which the force rises in a row. Sensitive: `static` hardly."""
STATIC_STEPS = 200
"""values of a coefficient of sticking that are tried, from that of sliding ... Sensitive: no."""
STATIC_RANGE = 2.5
"""... to so many times it: wider than the pairs of dry surfaces that handbooks list (mostly 1.0 to 1.5). Sensitive:
`static` hardly."""
STICKIER = 0.3
"""part by which things stick better than they slide, usually: steel on steel 0.74 and 0.57, copper on steel 0.53 and
0.36, rubber on concrete 1.0 and 0.8 (tables of textbooks, e.g. Serway, Physics for Scientists and Engineers, table
5.1) ... Sensitive: `static` hardly."""
STICKIER_FACTOR = 2.5
"""... by so many times more or less (1 sigma). Sensitive: `static` hardly."""
TURNING = 0.5
"""part (1 sigma), that is not known, of what joints that turn round rub less than they will: over how many mrad they
do, `PRESLIDING`, is known to a factor of two or so. Sensitive: `static` std ×0.8 at 0 where joints rub by 0.4 N m."""
STATIC_NOISE = 0.005
"""noise of a row's quotient of forces that is always assumed: what rises does not rise in a straight line.
Sensitive: `static` hardly."""
PARTINGS_SEEN = 0.5
"""part of what is not known of static friction before, from which breakaways say something of it. Sensitive: no."""

FLOOR = 1e-300
"""Keeps a logarithm finite."""


@dataclass(frozen=True, slots=True, eq=False)
class Parting:
    """Likelihood of the static coefficient from one breakaway.

    Attributes:
        drag: its number.
        chance: (m,) of each tried value, without the uncertainty of other causes than friction.
        mean, variance: of that likelihood.
        rows: at the limit of sticking.
        normal: N, in these rows.
        turning: N, difference of the joints' friction in them from that after the joints have reversed.
    """

    drag: int
    chance: Array
    mean: float
    variance: float
    rows: slice
    normal: float
    turning: float


def static_friction(drags: Sequence[Drag], sliding: Sliding) -> tuple[float, float] | None:
    """mu_s and its standard deviation, from the force at each breakaway; None without one.

    A scatter of the breakaways beyond their standard deviations widens it (Birge's ratio; e.g. Particle
    Data Group, Review of Particle Physics, 2024, introduction, section 5.2.2).
    """
    mu = sliding.friction[0]
    values = np.linspace(1.0, STATIC_RANGE, STATIC_STEPS) * mu
    seen = [
        parting_of(i, drag, sliding, values)
        for i, drag in enumerate(drags)
        # Where the hand did not rest before, the object may have slid all along.
        if drag.breakaway is not None and drag.begins >= PARTING_ROWS
    ]
    # Log-normal prior of the excess of static over sliding friction.
    ratios = values / mu
    beyond = np.maximum(ratios - 1.0, ratios[1] - 1.0)
    log_ratio = np.log(beyond / STICKIER) / np.log(STICKIER_FACTOR)
    expected: Array = np.exp(-0.5 * log_ratio**2) / beyond
    if not seen:
        return None
    aside = np.array([_scatter_std(sliding, [parting], np.ones(1)) ** 2 for parting in seen])
    chance = expected
    for parting, variance in zip(seen, aside.tolist(), strict=True):
        chance = chance * convolve_normal(parting.chance, values, variance)
    mean, variance = _moments(chance, values)
    if variance > PARTINGS_SEEN**2 * _moments(expected, values)[1]:
        return None
    own = np.array([parting.variance for parting in seen])
    means = np.array([parting.mean for parting in seen])
    weight = 1.0 / (own + aside)
    excess = float(np.mean((means - mean) ** 2 * weight))
    weight /= weight.sum()
    # Other causes are partly common to all drags.
    common = max(0.0, _scatter_std(sliding, seen, weight) ** 2 - float(weight**2 @ aside))
    return mean, float(np.sqrt(max(1.0, excess) * variance + common))


def _moments(chance: Array, values: Array) -> tuple[float, float]:
    """Mean and variance of values (m,) weighted by `chance`."""
    mean = float(chance @ values / chance.sum())
    return mean, float(chance @ (values - mean) ** 2 / chance.sum())


def convolve_normal(chance: Array, values: Array, variance: float) -> Array:
    """Chances (m,) of values, convolved with a normal distribution of this variance."""
    spread = max(variance, (values[1] - values[0]) ** 2)
    kernel = np.exp(-0.5 * (values[:, None] - values) ** 2 / spread)
    wide: Array = (kernel / kernel.sum(axis=0)) @ chance
    return wide / wide.max()


def _scatter_std(sliding: Sliding, seen: Sequence[Parting], weight: Array) -> float:
    """Standard deviation of a weighted mean of breakaways by other causes than friction of the object."""
    each = list(zip(seen, weight.tolist(), strict=True))
    turning = sum(share * part.turning / part.normal for part, share in each)
    others = sliding.apart([(part.drag, part.rows, share / part.normal) for part, share in each])
    return float(np.hypot(others, TURNING * turning))


def parting_of(number: int, drag: Drag, sliding: Sliding, values: Array) -> Parting:
    """Likelihood of each of `values` (m,) of the static coefficient from a drag; the first is the sliding
    coefficient."""
    mass, mass_std = apparent_mass(number, drag, sliding)
    normal = np.maximum(drag.normal, NORMAL_MIN)
    ratio = (drag.tangential - sliding.other_causes(number) - mass * drag.acceleration) / normal
    scatter = max(drag.row_variance(), drag.noise)
    noise = np.hypot(np.sqrt(scatter) / normal, STATIC_NOISE)
    # From the visible rise to steady sliding: the hand follows soon after the breakaway.
    seen = slice(drag.begins - PARTING_ROWS, drag.follows + 3 * PARTING_ROWS)
    likely = segmentation_likelihood(ratio[seen], noise[seen], values)
    falls, holds = np.unravel_index(np.argmax(likely.max(axis=2)), likely.shape[:2])
    rows = slice(seen.start + int(falls - holds), seen.start + int(falls) + 1)
    # Or the breakaway was before these rows, at any value, and the object slides in all of them.
    slid = log_normal_density(ratio[seen] - values[0], noise[seen])[PARTING_ROWS:].sum()
    before = -PARTING_ROWS * np.log(2.0 * values)
    most = max(float(likely.max()), slid + before.max())
    chance: Array = np.exp(likely - most).mean(axis=(0, 1)) + np.exp(slid + before - most)
    # While its foot sticks the object turns in the grip, so that only part of its mass moves with the hand.
    pressed = float(normal[rows].mean())
    accelerated = float(drag.acceleration[rows].mean())
    turning = drag.mass * accelerated / pressed
    unsure = np.hypot(mass_std * accelerated, INERTIA_SHARE * float(drag.inertial[rows].mean()))
    wider = turning**2 / 12.0 + float(unsure / pressed) ** 2
    moved: Array = np.interp(values - turning / 2.0, values, chance)
    chance = convolve_normal(moved, values, wider)
    less = sliding.turning(number, rows, drag.steady)
    return Parting(number, chance, *_moments(chance, values), rows, pressed, less)


def segmentation_likelihood(ratio: Array, noise: Array, values: Array) -> Array:
    """(n, h, m) log likelihood of force ratios (n,) with std `noise`, if row i is the last before breakaway,
    after j + 1 rows at the k-th of `values` (m,), the first of which holds during sliding. All hypotheses
    explain the same rows, so that they compare."""
    count, mu = len(ratio), float(values[0])
    parting = breakaway_likelihood(ratio, noise, mu, values)
    # Cumulative sums from 0, so that any stretch is a difference.
    each = log_normal_density(ratio[:, None] - values, noise[:, None])
    holding = np.concatenate([np.zeros_like(each[:1]), np.cumsum(each, axis=0)])
    sliding = np.concatenate(
        [np.zeros(1), np.cumsum(log_normal_density(ratio - mu, noise), axis=0)]
    )
    # Before the rise, the force may have any value.
    anything = -np.log(2.0 * values)
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
    """(n - 1, m) log likelihood of two neighbouring ratios with the breakaway between them."""
    # The breakaway is up to half a row earlier or later, and accelerations are means over two rows: half of the
    # fall is in the two rows, none to all of that half in the first.
    fall = values - mu
    each = [
        log_normal_density(ratio[:-1, None] - (values - part * fall), noise[:-1, None])
        + log_normal_density(ratio[1:, None] - (mu + (0.5 - part) * fall), noise[1:, None])
        for part in (0.0, 0.25, 0.5)
    ]
    likely: Array = np.logaddexp.reduce(each) - np.log(len(each))
    return likely


def rise_likelihood(ratio: Array, noise: Array, values: Array) -> Array:
    """(m,) log likelihood of quotients that rise in a straight line up to each of `values`, with unknown slope,
    the last of them a whole step or half a step below."""
    whole = np.arange(len(ratio), 0.0, -1.0)
    short = (values - ratio[:, None]) / noise[:, None]
    steep = (RISING * values) ** 2
    each: list[Array] = []
    for within in (0.0, 0.5):
        ahead = (whole - within) / noise
        known = 1.0 + steep * float(ahead @ ahead)
        slope = steep / known * (ahead @ short)
        square = (short**2).sum(axis=0) - slope * (ahead @ short)
        upwards = 2.0 * _below(slope / np.sqrt(steep / known))
        each.append(np.log(np.maximum(upwards, FLOOR)) - 0.5 * (square + np.log(known)))
    likely: Array = np.logaddexp.reduce(each) - np.log(len(each))
    return likely - np.log(noise * np.sqrt(2.0 * np.pi)).sum()


def _below(z: Array) -> Array:
    """The standard normal distribution below `z`, from a table."""
    found: Array = np.interp(z, *_table())
    return found


@cache
def _table() -> tuple[Array, Array]:
    """(n,) numbers, and the standard normal distribution below each."""
    at = np.linspace(-9.0, 9.0, 181)
    return at, np.array([0.5 * erfc(-x / sqrt(2.0)) for x in at.tolist()])


def log_normal_density(off: Array, noise: Array) -> Array:
    """Log density of a normal distribution at a deviation `off`."""
    return -0.5 * (off / noise) ** 2 - np.log(noise * np.sqrt(2.0 * np.pi))


def apparent_mass(number: int, drag: Drag, sliding: Sliding) -> tuple[float, float]:
    """Apparent mass of an arm with unknown links in the direction of a drag beyond `HORIZONTAL_MASS`, kg, and its
    standard deviation: change of the force over change of the speed as the hand slows down."""
    if not drag.unsure_mass:
        return 0.0, 0.0
    prior = drag.unsure_mass**-2
    rows = drag.slowing
    lost = -float(drag.acceleration[rows].sum())
    if lost <= 0.0:
        return 0.0, prior**-0.5
    aside, aside_std = sliding.aside(number, rows)
    count = rows.stop - rows.start
    friction = sliding.friction[0] * float(drag.normal[rows].sum())
    excess = float(drag.tangential[rows].sum()) - friction - count * aside
    variance = (count * drag.row_variance() + (count * aside_std) ** 2) / lost**2
    known = 1.0 / max(variance, MASS_ERROR**2)
    return -excess / lost * known / (known + prior), (known + prior) ** -0.5
