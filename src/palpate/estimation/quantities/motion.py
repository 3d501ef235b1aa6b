"""Velocity of the hand, and momentum of a held object."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np

from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Estimate, FurtherValue, half95, not_measured
from palpate.estimation.motion import mean_velocity
from palpate.estimation.quantities.quantity import Evidence, Quantity
from palpate.estimation.weighing import weigh
from palpate.mjcf.body import Body
from palpate.trace.samples import FORCES, Trace

VELOCITY_UNIT, MOMENTUM_UNIT = "m/s", "kg·m/s"


class Velocity(Quantity):
    """Mean linear velocity of the gripper in world axes."""

    id = "velocity"
    unit = VELOCITY_UNIT
    subject = "gripper"
    words: ClassVar = {
        "en": ("velocity", "speed"),
        "de": ("geschwindigkeit",),
        "es": ("velocidad",),
        "fr": ("vitesse",),
        "it": ("velocità",),
    }
    size = 3
    evidence = (
        Evidence(
            FORCES, "MeasureForces in a Parallel with a motion", activity=("moving", "sliding")
        ),
    )
    estimators: ClassVar = {
        "displacement": "palpate.estimation.quantities.motion:estimate_velocity"
    }


def estimate_velocity(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Mean linear velocity of the TCP over the recording, world axes: displacement over duration.

    `parts` holds the mean of the sensed twist as `mean twist x/y/z`, and the `peak speed`.
    Raises ValueError: the recording has fewer than two samples.
    """
    recording = trace.converted(parameter)
    if recording is None:
        return not_measured(parameter, VELOCITY_UNIT)
    # Mean velocity from the displacement; mean and peak of the sensed twist are further results.
    velocity = mean_velocity(trace, recording)
    twist = trace.of(recording).twist[:, :3]
    means, stds = twist.mean(axis=0), twist.std(axis=0) / np.sqrt(len(twist))
    parts: dict[str, FurtherValue] = {}
    for axis, mean, std in zip("xyz", means, stds, strict=True):
        parts[f"mean twist {axis}"] = FurtherValue(float(mean), float(std))
    peak = float(np.linalg.norm(twist, axis=1).max())
    parts["peak speed"] = FurtherValue(peak, float(velocity.std[0]))
    method = (
        f"Displacement of the tool centre over the {velocity.duration:.2f} s of the recording, "
        "which is its mean velocity."
    )
    return Estimate.normal(
        parameter,
        VELOCITY_UNIT,
        velocity.value,
        velocity.std,
        method,
        evidence=(recording,),
        parts=parts,
        views=(velocity.view(trace, recording),),
    )


class Momentum(Quantity):
    """Mean momentum of the held object, in world axes."""

    id = "momentum"
    unit = MOMENTUM_UNIT
    subject = "gripper"
    words: ClassVar = {"en": ("momentum",), "de": ("impuls",), "fr": ("quantité de mouvement",)}
    size = 3
    evidence = (
        Evidence(
            FORCES,
            "MeasureForces in a Parallel with a motion while holding an object",
            activity=("moving",),
            holding=True,
        ),
    )
    estimators: ClassVar = {"product": "palpate.estimation.quantities.motion:estimate_momentum"}


def estimate_momentum(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Mean momentum m v of the held object over the recording, world axes.

    The mass is from the loaded and empty passes and rests of the same trace, without the hand.
    Raises ValueError: the recording has fewer than two samples.
    """
    recording = trace.converted(parameter)
    if recording is None:
        return not_measured(parameter, MOMENTUM_UNIT)
    velocity = mean_velocity(trace, recording)
    weight = weigh(trace, recording)
    light = weight.mass < half95(weight.best.freedom) * weight.std
    # Product of independent factors: relative variances add, to first order.
    std = np.hypot(weight.mass * velocity.std, weight.std * velocity.value)
    # Show the fits of both factors; the interval of the product applies to neither, so it has no slopes.
    fits = (weight.view(), velocity.view(trace, recording))
    method = (
        "Mean velocity of the recording times the object's mass from the same trace "
        f"({weight.mass:.3f} kg)."
    )
    return Estimate.normal(
        parameter,
        MOMENTUM_UNIT,
        weight.mass * velocity.value,
        std,
        method,
        evidence=(recording,),
        reason=weight.doubt or ("the mass is not told from zero" if light else ""),
        parts={"mass": FurtherValue(weight.mass, weight.std, "kg")},
        tests=weight.load.tests,
        views=tuple(replace(view, slopes=None) for view in fits),
    )
