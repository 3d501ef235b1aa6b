"""Load estimate from all free motion around a weighing, not only from passes along one path.

Away from the path of a lift no empty pass at the same place exists for a contrast. But the joint torques
there have few causes, each linear in unknown numbers: weight and place of the load, errors in the masses and
centres of the arm's links, zeros and gains of the sensors, friction (Dahl's, and viscous), residual stiction
of rests, and the tilt of gravity. All are fitted together by generalised least squares. The result is more
precise than a contrast along the path. What the model leaves beyond the noise, ripple or friction that changes
with the place, is a coloured residual, learned from the recording, and widens it (`estimation.coloured`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.common.pose import Array
from palpate.estimation.coloured_residual import learn_residual, with_residual
from palpate.estimation.load_blocks import Blocks, blocks, free_rows
from palpate.estimation.load_causes import (
    LINK,
    by_signal,
    free_noise,
    of_arm,
    of_load,
    of_turning,
    scales,
)
from palpate.estimation.load_noise import SignalLevels
from palpate.estimation.regression import Cause, Posterior, SignalNoise, fit
from palpate.estimation.wrench_observation import CROSSTALK, GAIN, WrenchObservation, observe
from palpate.trace.samples import Trace


@dataclass(frozen=True, slots=True, eq=False)
class WholeLoad:
    """Load from all free motion around n grasps.

    Attributes:
        grasps: s, when the hand had closed on it.
        value: (1 + 3n,) weight, N, and in each grasp the first moment of the weight along the axes of the
            hand, N m.
        covariance: (1 + 3n, 1 + 3n) of `value`.
        gains: (1 + 3n, m) effect on `value` of one standard deviation of each cause of the sensors' gains.
        crosstalk: (1 + 3n, m) effect on `value` of one standard deviation of each sensor's cross-talk.
        links: (1 + 3n,) effect on `value` of each error of the arm's links, by name.
        misfit: mean square of the residuals, in units of the noise.
        seen, posterior: of the fit.
    """

    grasps: tuple[float, ...]
    value: Array
    covariance: Array
    gains: Array
    crosstalk: Array
    links: Mapping[str, Array]
    misfit: float
    seen: Blocks
    posterior: Posterior

    @property
    def force(self) -> float:
        """N."""
        return float(self.value[0])

    @property
    def std(self) -> float:
        """N, of the force."""
        return float(np.sqrt(self.covariance[0, 0]))

    def at(self, grasps: Sequence[float], tools: Sequence[Array]) -> Array | None:
        """(1 + 2n, 1 + 3n) matrix from `value` to force and moments as in `estimation.load.fit.Load`, for n
        grasps, s, with the axes of the hand in the world (3, 3); None where it did not hang free in one."""
        if not set(grasps) <= set(self.grasps):
            return None
        turned = np.zeros((1 + 2 * len(grasps), len(self.value)))
        turned[0, 0] = 1.0
        for i, (grasp, tool) in enumerate(zip(grasps, tools, strict=True)):
            first = 1 + 3 * self.grasps.index(grasp)
            turned[1 + 2 * i, first : first + 3] = tool[1]
            turned[2 + 2 * i, first : first + 3] = -tool[0]
        return turned


def fit_whole(trace: Trace, name: str, noise: SignalLevels, about_force: float) -> WholeLoad | None:
    """Fit the load `name` to all the time it hung on the hand, linearised at `about_force` N; None where the
    arm's links are unknown, or it never hung free.

    Used is all free motion, or only motion that certainly is free: so high that a tilted object has left its
    support with its far end, too, close to where it hung, and settled at rests or well away from them. What the
    model leaves of the former widens it; the narrower of both counts.
    """
    observed = observe(trace)
    if observed.chain is None or not observed.knows_links:
        return None
    found: list[WholeLoad] = []
    for surely in (False, True):
        if free := free_rows(trace, name, surely):
            seen = blocks(trace, observed, name, free, surely)
            found.append(_fit_whole(trace, observed, seen, noise, about_force))
    return min(found, key=lambda whole: whole.std, default=None)


def _fit_whole(
    trace: Trace, observed: WrenchObservation, seen: Blocks, noise: SignalLevels, about_force: float
) -> WholeLoad:
    load = list(of_load(seen, seen.pull))
    count = sum(len(cause.prior) for cause in load)
    about = np.zeros(count)
    about[0] = about_force
    # Effects of gains are in proportion to the moments, too, which are unknown at first.
    sensors = free_noise(seen, noise)
    about = _posterior(trace, observed, seen, sensors, load, about).mean[:count]
    found = _posterior(trace, observed, seen, sensors, load, about)
    left = learn_residual(found.causes, sensors, by_signal(seen.observed), seen.spans)
    found = _posterior(trace, observed, seen, with_residual(sensors, left, seen.spans), load, about)
    links: dict[str, Array] = {}
    for cause in found.causes:
        if cause.name.startswith(LINK):
            links |= zip(cause.labels, found.effects(cause.name)[:count].T, strict=True)
    misfit = float(np.mean(found.residual**2))
    value, square = found.mean[:count], found.covariance[:count, :count]
    gains, crosstalk = (found.effects(name)[:count] for name in (GAIN, CROSSTALK))
    return WholeLoad(seen.grasps, value, square, gains, crosstalk, links, misfit, seen, found)


def _posterior(
    trace: Trace,
    observed: WrenchObservation,
    seen: Blocks,
    noise: SignalNoise,
    load: Sequence[Cause],
    about: Array,
) -> Posterior:
    """Posterior of all causes, of signals whose noise is known, where those of the load are `about` (1 + 3n,)."""
    borne = np.concatenate([cause.columns for cause in load], axis=1) @ about
    lifted = about[0] * seen.pull[:, 2]
    causes = [*load, of_turning(seen), *of_arm(trace, observed, seen, lifted, borne)]
    return fit(causes, noise, by_signal(seen.observed), scales(causes))
