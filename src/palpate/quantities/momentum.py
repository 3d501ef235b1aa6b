"""Momentum of a held object."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np

from palpate.estimation.estimate import Estimate, not_measured
from palpate.estimation.load.weighing import weigh
from palpate.estimation.motion import mean_velocity
from palpate.mjcf.body import Body
from palpate.parameter import Parameter
from palpate.quantities.evidence import Evidence
from palpate.quantities.quantity import Quantity
from palpate.trace.samples import FORCES, Trace

UNIT = "kg·m/s"


class Momentum(Quantity):
    """Mean momentum of what the gripper holds, in world axes."""

    id = "momentum"
    unit = UNIT
    subject = "gripper"
    words: ClassVar = {
        "en": ("momentum",),
        "de": ("impuls",),
        "fr": ("quantité de mouvement",),
    }
    size = 3
    evidence = (
        Evidence(
            FORCES,
            "MeasureForces in a Parallel with a motion while holding an object",
            activity=("moving",),
            holding=True,
        ),
    )
    estimators: ClassVar = {"product": "palpate.quantities.momentum:estimate_momentum"}


def estimate_momentum(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Mean momentum m v of the held object over the recording, world axes.

    The mass comes from the loaded and empty passes and rests of the same trace, so it includes
    nothing of the hand.

    Raises:
        ValueError: the recording has fewer than two samples.
    """
    recording = trace.converted(parameter)
    if recording is None:
        return not_measured(parameter, UNIT)
    velocity = mean_velocity(trace, recording)
    weight = weigh(trace, recording)
    # Of a product of independent factors: the relative variances add, to first order.
    std = np.hypot(weight.mass * velocity.std, weight.std * velocity.value)
    # Both factors' fits; the momentum is their product, so that its interval is neither's.
    fits = (weight.view(trace.gravity), velocity.view(trace, recording))
    method = (
        "Mean velocity of the recording times the object's mass from the same trace "
        f"({weight.mass:.3f} kg)."
    )
    return Estimate.normal(
        parameter,
        UNIT,
        weight.mass * velocity.value,
        std,
        method,
        (recording,),
        weight.verdict,
        {"mass": weight.part},
        tests=weight.tests,
        views=tuple(replace(view, slopes=None) for view in fits),
    )
