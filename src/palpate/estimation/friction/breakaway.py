"""Static friction: the force at which a held object begins to slide."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.friction.drags import Drag
from palpate.estimation.friction.fit import Sliding


@dataclass(frozen=True, slots=True)
class _Peak:
    """One breakaway.

    Attributes:
        ratio: mu_s as it shows it. variance: of its own. inertia: by how much the arm's apparent
            mass (1 sigma), which all breakaways have in common, moves it.
    """

    ratio: float
    variance: float
    inertia: float


def static_friction(drags: Sequence[Drag], sliding: Sliding) -> tuple[float, float] | None:
    """mu_s and its standard deviation, from the force at each breakaway; None without one.

    Where breakaways differ by more than they should, that widens it (Birge's ratio; e.g. Particle
    Data Group, Review of Particle Physics, 2024, introduction, section 5.2.2).
    """
    peaks = list(_peaks(drags, sliding))
    if not peaks:
        return None
    ratios = np.array([peak.ratio for peak in peaks])
    own = np.array([peak.variance for peak in peaks])
    inertia = np.array([peak.inertia for peak in peaks])
    weight = 1.0 / (own + inertia**2)
    weight /= weight.sum()
    mean = float(weight @ ratios)
    excess = float(np.mean((ratios - mean) ** 2 / (own + inertia**2)))
    variance = max(1.0, excess) * float(weight**2 @ own) + float(weight @ inertia) ** 2
    return mean, float(np.sqrt(variance))


def _peaks(drags: Sequence[Drag], sliding: Sliding) -> Iterator[_Peak]:
    for i, drag in enumerate(drags):
        peaks = [_peak(drag, rows, *sliding.aside(i, rows)) for rows in drag.parting]
        if peaks:
            yield max(peaks, key=lambda peak: peak.ratio)


def _peak(drag: Drag, rows: slice, aside: float, aside_std: float) -> _Peak:
    """The quotient of forces in `rows`; `aside` (N) is what of the force is no friction."""
    normal = max(float(drag.normal[rows].mean()), tuning.NORMAL_MIN)
    force = float(drag.tangential[rows].mean()) - aside
    noise = drag.row_variance() / (rows.stop - rows.start)
    inertia = tuning.HORIZONTAL_SPREAD * float(np.abs(drag.acceleration[rows]).max())
    return _Peak(force / normal, (noise + aside_std**2) / normal**2, inertia / normal)
