"""Velocity of the hand, and so of what it holds."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from palpate.estimation.estimate import Estimate, Part, not_measured
from palpate.estimation.motion import mean_velocity
from palpate.mjcf.body import Body
from palpate.parameter import Parameter
from palpate.quantities.evidence import Evidence
from palpate.quantities.quantity import Quantity
from palpate.trace.samples import FORCES, Trace

UNIT = "m/s"


class Velocity(Quantity):
    """Mean linear velocity of the gripper in world axes."""

    id = "velocity"
    unit = UNIT
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
    estimators: ClassVar = {"displacement": "palpate.quantities.velocity:estimate_velocity"}


def estimate_velocity(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Mean linear velocity of the TCP over the recording, world axes.

    It is the displacement over the duration; the mean of the sensed twist is in `parts` as `mean
    twist x/y/z`, and `peak speed` beside it.

    Raises:
        ValueError: the recording has fewer than two samples.
    """
    recording = trace.converted(parameter)
    if recording is None:
        return not_measured(parameter, UNIT)
    velocity = mean_velocity(trace, recording)
    twist = trace.of(recording).twist[:, :3]
    means, stds = twist.mean(axis=0), twist.std(axis=0) / np.sqrt(len(twist))
    parts: dict[str, Part] = {}
    for axis, mean, std in zip("xyz", means, stds, strict=True):
        parts[f"mean twist {axis}"] = Part(float(mean), float(std))
    peak = float(np.linalg.norm(twist, axis=1).max())
    parts["peak speed"] = Part(peak, float(velocity.std[0]))
    method = (
        f"Displacement of the tool centre over the {velocity.duration:.2f} s of the recording, "
        "which is its mean velocity."
    )
    return Estimate.normal(
        parameter,
        UNIT,
        velocity.value,
        velocity.std,
        method,
        (recording,),
        parts=parts,
        views=(velocity.view(trace, recording),),
    )
