"""Static friction: the force at which a held object begins to slide.

The hand gains speed as the object breaks away, and the arm's inertia takes its part of the force.
How much that is in the direction of a drag shows at its end: there the hand slows down while the
object still slides, and the momentum that the arm loses is in the force.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.friction.drags import Drag
from palpate.estimation.friction.fit import Sliding


@dataclass(frozen=True, slots=True)
class _Peak:
    """One breakaway: mu_s as it shows it, and the variance of that."""

    ratio: float
    variance: float


def static_friction(drags: Sequence[Drag], sliding: Sliding) -> tuple[float, float] | None:
    """mu_s and its standard deviation, from the force at each breakaway; None without one.

    Where breakaways differ by more than they should, that widens it (Birge's ratio; e.g. Particle
    Data Group, Review of Particle Physics, 2024, introduction, section 5.2.2).
    """
    peaks = list(_peaks(drags, sliding))
    if not peaks:
        return None
    ratios = np.array([peak.ratio for peak in peaks])
    variance = np.array([peak.variance for peak in peaks])
    weight = 1.0 / variance
    mean = float(weight @ ratios / weight.sum())
    excess = float(np.mean((ratios - mean) ** 2 / variance))
    own = np.sqrt(max(1.0, excess) / weight.sum())
    return mean * (1.0 + tuning.RISING), float(np.hypot(own, tuning.BREAKAWAY * mean))


def _peaks(drags: Sequence[Drag], sliding: Sliding) -> Iterator[_Peak]:
    for i, drag in enumerate(drags):
        rows = drag.parting
        if rows is not None:
            mass = _further_mass(i, drag, sliding)
            yield _peak(drag, rows, *sliding.aside(i, rows), *mass)


def _peak(
    drag: Drag, rows: slice, aside: float, aside_std: float, mass: float, mass_std: float
) -> _Peak:
    """The quotient of forces in `rows`; `aside` (N) is what of the force is no friction, `mass` (kg)
    what the arm seems to have beyond what was taken off."""
    normal = max(float(drag.normal[rows].mean()), tuning.NORMAL_MIN)
    gained = drag.acceleration[rows]
    force = float(drag.tangential[rows].mean() - mass * gained.mean()) - aside
    noise = drag.row_variance() / (rows.stop - rows.start)
    inertia = float(np.hypot(mass_std, tuning.TURNING_MASS)) * float(np.abs(gained).max())
    return _Peak(force / normal, (noise + aside_std**2 + inertia**2) / normal**2)


def _further_mass(number: int, drag: Drag, sliding: Sliding) -> tuple[float, float]:
    """kg that an arm of unknown links seems to have in a drag's direction beyond `HORIZONTAL_MASS`, and
    the standard deviation: what the force lost as the hand slowed down, over the loss of speed."""
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
    known = 1.0 / max(variance, tuning.MASS_ERROR**2)
    return -excess / lost * known / (known + prior), (known + prior) ** -0.5
