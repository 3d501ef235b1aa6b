"""Load estimate from all free motion around a weighing, not only from passes along one path.

Away from the path of a lift there is no empty pass at the same place for a contrast. The joint
torques there have few causes, each linear in its unknowns:

    weight and lever of the load
    errors in the masses and centres of the arm's links
    zeros and gains of the sensors
    joint friction (Dahl's, and viscous), and residual stiction of rests
    tilt of gravity

All are fitted together by generalised least squares. The result is more precise than a contrast
along the path. The model leaves a residual beyond the noise, such as ripple or friction that
changes with the place. It is learned from the recording and widens the result
(`coloured_residual`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.common.pose import Array
from palpate.estimation.estimate import Shared, map_shared
from palpate.estimation.joint_causes import (
    arm_scales,
    build_free_motion,
    build_load,
    build_noise,
    by_signal,
    fit_blocks,
)
from palpate.estimation.load_blocks import Blocks, blocks, free_rows
from palpate.estimation.load_noise import SignalLevels
from palpate.estimation.regression import Cause, Posterior, fit
from palpate.estimation.sensed_load import SensedGrasps, fit_sensed_grasps
from palpate.estimation.wrench_observation import WrenchObservation, observe
from palpate.trace.samples import Trace


@dataclass(frozen=True, slots=True, eq=False)
class WholeLoad:
    """Load from all free motion around n grasps."""

    grasps: tuple[float, ...]  # s, times at which the hand had closed on it
    # (1 + 3n,) weight, N, and in each grasp the first moment of the weight along the axes of the
    # hand, N m.
    value: Array
    covariance: Array  # (1 + 3n, 1 + 3n) of `value`
    shared: tuple[
        Shared, ...
    ]  # errors of the arm in common with other runs, with effects on `value`
    misfit: float  # mean square of the residuals, in units of the noise
    seen: Blocks  # block means that were fitted
    posterior: Posterior  # of the fit

    @property
    def force(self) -> float:
        """N, weight of the load."""
        return float(self.value[0])

    @property
    def std(self) -> float:
        """N, standard deviation of the weight."""
        return float(np.sqrt(self.covariance[0, 0]))

    def at(self, grasps: Sequence[float], tools: Sequence[Array]) -> Array | None:
        """Build the matrix (1 + 2n, 1 + 3n) from `value` to force and moments as in
        `LoadEstimate.value`.

        None where the load did not hang free in one of the grasps.

        Args:
            grasps: s, n of them.
            tools: (3, 3) each, axes of the hand in the world at each grasp.
        """
        if not set(grasps) <= set(self.grasps):
            return None
        turned = np.zeros((1 + 2 * len(grasps), len(self.value)))
        turned[0, 0] = 1.0
        # Moments of a weight about world x and y: lever y times F, and minus lever x times F.
        for i, (grasp, tool) in enumerate(zip(grasps, tools, strict=True)):
            first = 1 + 3 * self.grasps.index(grasp)
            turned[1 + 2 * i, first : first + 3] = tool[1]
            turned[2 + 2 * i, first : first + 3] = -tool[0]
        return turned


def fit_whole(trace: Trace, name: str, noise: SignalLevels, about_force: float) -> WholeLoad | None:
    """Fit the load `name` to all the time it hung on the hand, linearised at `about_force` N.

    Two sets of rows are tried: all free motion, and only motion that certainly is free. Certainly
    free motion is high enough that the far end of a tilted object has left its support. It is close
    to where the load hung, and settled at rests or well away from them. The residual of the model
    widens each result, and the narrower counts.

    None where the arm's links are unknown, or the load never hung free.
    """
    observed = observe(trace)
    if observed.chain is None or not observed.knows_links:
        return None
    # Fit all free motion, and the certainly free motion alone.
    found: list[WholeLoad] = []
    for surely in (False, True):
        if free := free_rows(trace, name, surely):
            seen = blocks(trace, observed, name, free, surely)
            found.append(_fit_whole(trace, observed, seen, noise, about_force))
    best = min(found, key=lambda whole: whole.std, default=None)
    sensed = None if best is None else fit_sensed_grasps(trace, name)
    return best if best is None or sensed is None else _with_sensor(best, sensed)


def _with_sensor(whole: WholeLoad, sensed: SensedGrasps) -> WholeLoad:
    """Combine the load by the joint torques with that by a six-axis sensor.

    Both sets of rows have only the load in common. Their joint posterior is the product of both normal densities.
    """
    if len(whole.value) != len(sensed.value):
        return whole
    # Weight of the sensor's result, in the form of a Kalman gain.
    both = whole.covariance + sensed.covariance
    gain = np.linalg.solve(both, whole.covariance).T
    rest = np.eye(len(gain)) - gain
    own = Shared("gain of the wrench sensor", "arm", tuple((gain @ sensed.gain).tolist()))
    return replace(
        whole,
        value=whole.value + gain @ (sensed.value - whole.value),
        covariance=rest @ whole.covariance,
        shared=(*map_shared(whole.shared, rest), own),
    )


def _fit_whole(
    trace: Trace, observed: WrenchObservation, seen: Blocks, noise: SignalLevels, about_force: float
) -> WholeLoad:
    """Fit the load to block means: iterate the linearisation, then learn the residual of the model."""
    load = list(build_load(seen, seen.pull))
    columns = np.concatenate([cause.columns for cause in load], axis=1)
    about = np.zeros(columns.shape[1])
    about[0] = about_force

    def causes() -> list[Cause]:
        """Build all causes, with the effects of gains and tilt at the load `about` (1 + 3n,)."""
        lifted = about[0] * seen.pull[:, 2]
        return build_free_motion(trace, observed, seen, load, lifted, columns @ about)

    # Gains act in proportion to the moments, which are unknown at first: solve twice.
    first = causes()
    sensors, count = build_noise(seen, noise), len(about)
    about = fit(first, sensors, by_signal(seen.observed), arm_scales(first)).mean[:count]
    found = fit_blocks(causes(), seen, noise)
    misfit = float(np.mean(found.residual**2))
    value, square = found.mean[:count], found.covariance[:count, :count]
    return WholeLoad(seen.grasps, value, square, found.shared(slice(count)), misfit, seen, found)
