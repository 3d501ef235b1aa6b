"""The gains of the joints' torque sensors, from a load whose weight is known.

The load's own equations (`palpate.estimation.load.fit`) hold one unknown for the gain of each joint.
Where the weight is sought they bound it; where it is known, it tells of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.calibration.stated import Stated
from palpate.errors import InputError
from palpate.estimation import tuning
from palpate.estimation.agreement import FitTest, chi_squared
from palpate.estimation.load.equations import Model, equations
from palpate.estimation.load.fit import fit_load, load_model
from palpate.estimation.load.observation import gain_root
from palpate.estimation.load.segments import Weighing, weighings
from palpate.geometry.pose import Array
from palpate.parameter import Parameter
from palpate.robots.owner.config import JOINTS
from palpate.trace.recording import Hand
from palpate.trace.samples import Trace


@dataclass(frozen=True, slots=True, eq=False)
class GainBelief:
    """Gaussian of the torque sensors' relative gain errors: `mean` (7,), `covariance` (7, 7)."""

    mean: Array
    covariance: Array

    def after(self, corrected: Array) -> GainBelief:
        """Compose with gains `corrected` (7,) that the readings were already corrected by:
        1 + g = (1 + corrected)(1 + mean)."""
        larger = 1.0 + corrected
        whole = larger * (1.0 + self.mean) - 1.0
        return GainBelief(whole, self.covariance * np.outer(larger, larger))


def weighed(trace: Trace, parameter: Parameter, known: Stated) -> GainBelief:
    """Compute the posterior of the gains from a weighing of the `known` mass, kg, in `trace`; its readings
    are corrected by the earlier calibration.

    Raises:
        InputError: it was not weighed, its weighing contradicts itself, or what was felt is not what
            it is said to weigh.
    """
    recording = trace.converted(parameter)
    if recording is None or trace.hand.chain is None:
        raise InputError(f"{parameter.object} was not weighed; nothing is calibrated")
    found = weighings(trace, recording)
    _require_agreement(found, trace.gravity, trace.hand, known)
    return _learned(found, trace.gravity, trace.hand, known)


def _learned(found: Sequence[Weighing], gravity: float, hand: Hand, known: Stated) -> GainBelief:
    """The posterior of the gains, at a force that is known within its limits.

    A gain's column is the load itself, whose moments are not known at first: it is solved as often
    as when a mass is sought.
    """
    rows = [equations(weighing, gravity) for weighing in found]
    grasps = tuple(time for weighing in found for time in weighing.grasps)
    force, about = known.value * gravity, np.zeros(1 + 2 * len(grasps))
    about[0] = force
    model = load_model(rows, grasps, about, hand)
    mean, covariance = _solved(model, force, known.std * gravity)
    for _ in range(tuning.LOAD_ITERATIONS):
        about = np.concatenate([[force], mean[1 : len(about)]])
        model = load_model(rows, grasps, about, hand)
        mean, covariance = _solved(model, force, known.std * gravity)
    root = gain_root(hand, JOINTS)
    spread: Array = root @ covariance[-JOINTS:, -JOINTS:] @ root.T
    return GainBelief(root @ mean[-JOINTS:], spread)


def _solved(model: Model, force: float, std: float) -> tuple[Array, Array]:
    """Mean and covariance of the model's coefficients, the first of which is `force` ± `std`; the
    first mean is what it differs by."""
    prior = model.prior.copy()
    prior[0] = std
    news = model.y - model.design[:, 0] * force
    # The noise was known with so many degrees of freedom: the deviation of Student's t.
    wider = math.sqrt(max(1.0, model.freedom / max(model.freedom - 2.0, 1.0)))
    # That gains may be off by more than was told of them is counted by every fit that reads the file:
    # counted here, too, a joint that bears nothing would be known worse after a calibration than before.
    hyperpriors = tuple(one for one in model.hyperpriors if one.columns.start < len(prior) - JOINTS)
    scaled = replace(model, design=model.design / wider, y=news / wider, prior=prior)
    return replace(scaled, hyperpriors=hyperpriors).solve()


def _require_agreement(
    found: Sequence[Weighing], gravity: float, hand: Hand, known: Stated
) -> None:
    """Require that the weight hung free and agrees with its stated mass, within the gains'
    uncertainty."""
    load = fit_load(found, gravity, hand)
    mass, std = load.force / gravity, load.force_std / gravity
    apart = mass - known.value
    same = chi_squared(
        "weight",
        apart**2 / (std**2 + known.std**2),
        1,
        f"It feels like {1e3 * mass:.4g} g ± {1e3 * std:.2g} g and is said to be {known.text}: it is "
        "another one, or the arm is not as good as its datasheet.",
        load.freedom,
    )
    require([*load.tests, same], "the weight")


def require(tests: Sequence[FitTest], what: str) -> None:
    """Require that all tests passed.

    Raises:
        InputError: some did not; the message has what they found.
    """
    failed = [test.finding for test in tests if not test.passed]
    if failed:
        raise InputError(f"{what} contradicts: {' '.join(failed)} Nothing is written.")
