"""A guarded descent's loading curve: where the force began to rise, and where what was met became stiffer."""

from __future__ import annotations

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.contact.descent import Descent, steady


def at_most(descent: Descent) -> tuple[float, float]:
    """N that it pressed with at rest at most, and m, tip height meanwhile."""
    borne = descent.borne
    return float(np.mean(descent.smooth[borne])), float(np.median(descent.z[borne]))


def first_contact(descent: Descent, late: int) -> tuple[float, float]:
    """Tip height at which the force begins to rise, m, and its standard deviation.

    A rise shows late in the noise, so what gives way is carried back to no force, along the line
    F(z) through the lower half of its way.
    """
    z, onset = descent.z, descent.onset
    met = float(z[min(onset + 1, len(z) - 1)])
    row = float(np.abs(z[min(onset + 1, len(z) - 1)] - z[onset]))
    halfway = (met + float(z[late])) / 2
    rows = np.arange(onset + 1, late + 1)
    rows = rows[(z[rows] >= halfway) & steady(descent.samples)[rows]]
    if len(rows) < tuning.CURVE_ROWS:
        return met, max(row, tuning.UNSEEN)
    force = descent.smooth[rows]
    slope, offset = np.polyfit(z[rows], force, 1)
    if slope >= 0.0:
        return met, max(row, tuning.UNSEEN)
    root = float(np.clip(-offset / slope, met, met + (met - float(z[late]))))
    residual = float(np.std(descent.force[rows] - (slope * z[rows] + offset)))
    scatter = 2.0 * residual / (-float(slope) * np.sqrt(len(rows)))
    return root, float(np.hypot(scatter, max(row, tuning.UNSEEN)))


def knee(descent: Descent, late: int, first: float) -> float:
    """Force at which the last, stiffest stretch of the curve begins, N."""
    stiff = float(descent.z[late])
    if first - stiff < tuning.SOFT:
        return 0.0
    above = stiff + tuning.STIFF_SHARE * (first - stiff)
    soft = np.flatnonzero(descent.z[descent.onset : late + 1] > above)
    last = int(soft[-1]) if len(soft) else 0
    return max(float(descent.smooth[descent.onset + last]), 0.0)


def bottomed(descent: Descent, late: int, first: float) -> float | None:
    """m: the tip's height at which the surface became far stiffer than it had been: where its last stretch
    would bear nothing, if that is higher."""
    late_z, late_force = float(descent.z[late]), float(descent.smooth[late])
    most, deepest = at_most(descent)
    before = (first - late_z) / late_force
    after = (late_z - deepest) / (most - late_force)
    if first - late_z < tuning.SOFT or after > tuning.STIFFER * before:
        return None
    return late_z + max(tuning.STIFF_SHARE * (first - late_z), after * late_force)
