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
    common = aside_std**2 + inertia**2
    return _Peak(force / normal, own / normal**2, common / normal**2)
