"""Several touches of one surface as one height: their mean, or the plane through them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.view import FitView
from palpate.geometry.pose import Array


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """Plane through the touches of a surface.

    Attributes:
        height: m, of its middle among the touches.
        std: m, without what all touches share.
        tilt: rad, from level, and its standard deviation; None where the touches do not span a
            plane.
        slope: (2,) rise along x and along y, and slope_std; None where they do not.
        misfit: sum of the squared residuals over their variances.
        freedom: number of touches beyond the unknowns.
    """

    height: float
    std: float
    tilt: tuple[float, float] | None
    misfit: float
    freedom: int
    slope: Array | None = None
    slope_std: Array | None = None

    def at(self, spots: Array) -> Array:
        """(n,) m, its height at spots (n, 2) relative to the middle of the touches."""
        rise: Array = np.zeros(len(spots)) if self.slope is None else spots @ self.slope
        return self.height + rise


def fit_plane(spots: Array, heights: Sequence[float], stds: Sequence[float]) -> Plane:
    """Fit the plane through touches at `spots` (n, 2), m, by weighted least squares; where they do not span
    one, their weighted mean."""
    z, weight = np.asarray(heights), 1.0 / np.asarray(stds)
    middle = spots.mean(axis=0)
    level = np.ones((len(z), 1))
    leaning = np.hstack([level, spots - middle])
    design = leaning if spans_plane(spots) else level
    weighted = design * weight[:, None]
    covariance = np.linalg.inv(weighted.T @ weighted).astype(np.float64)
    solution: Array = covariance @ weighted.T @ (z * weight)
    misfit = float(np.sum(((z - design @ solution) * weight) ** 2))
    variance, tilt = float(covariance[0, 0]), None
    slope: Array | None = None
    slope_std: Array | None = None
    if design.shape[1] == 3:
        slope, slope_std = solution[1:], np.sqrt(np.diag(covariance)[1:])
        tilt = (float(np.linalg.norm(slope)), float(np.sqrt(np.mean(slope_std**2))))
        # The height of a tilted surface, one number, is as uncertain as the touches differ along the slope
        # (root mean square).
        rise: Array = (spots - middle) @ slope
        variance += float(np.mean(rise**2))
    freedom = len(z) - len(solution)
    height, std = float(solution[0]), float(np.sqrt(variance))
    return Plane(height, std, tilt, misfit, freedom, slope, slope_std)


def plane_view(
    plane: Plane, spots: Array, heights: Sequence[float], stds: Sequence[float], of_tilt: bool
) -> FitView:
    """Touches of a surface against the plane through them, from the side along its steepest direction;
    of an estimate of its tilt, or of its height."""
    beside = spots - spots.mean(axis=0)
    # Touches too close together for a slope are shown along world x.
    slope = np.array([1.0, 0.0]) if plane.slope is None else plane.slope
    uphill = slope / max(float(np.linalg.norm(slope)), 1e-12)
    heading = float(np.degrees(np.arctan2(uphill[1], uphill[0])))
    rises = "is level" if plane.slope is None else f"rises most towards {heading:.0f}° from world x"
    return FitView(
        name=f"The {len(spots)} touches, from the side.",
        note=f"Height of each touch and the fitted plane, which {rises}.",
        axes=("along the way uphill (mm)", f"height above {plane.height:.4f} m (mm)"),
        x=1e3 * beside @ uphill,
        measured=1e3 * (np.array(heights) - plane.height),
        predicted=1e3 * (plane.at(beside) - plane.height),
        std=1e3 * np.array(stds),
        groups="a touch",
        slopes=1e3 * (beside if of_tilt else np.ones((len(spots), 1))),
    )


def spans_plane(spots: Array) -> bool:
    """Three of the spots are at least `APART` from one another, and not collinear."""
    if len(spots) < 3:
        return False
    # Spread along the shorter main axis: APART / sqrt(6) of an equilateral triangle with sides APART; half of
    # that is still no line.
    centred = spots - spots.mean(axis=0)
    variances = np.linalg.eigvalsh(centred.T @ centred / len(spots)).astype(np.float64)
    return float(variances[0]) >= (tuning.APART / 2) ** 2 / 6
