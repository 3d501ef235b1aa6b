"""Mass of a held object."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import NormalDist

import numpy as np

from palpate.estimation.estimate import Estimate
from palpate.estimation.load import Contrast, Segment, fit_load, referenced, segments
from palpate.parameter import Parameter
from palpate.trace.recording import Conversion, Recording
from palpate.trace.samples import Trace

Z = 2
GAIN_AVERAGE = 0.7
"""Two joints carry a vertical load about equally; the gain errors of both average to 1/sqrt(2) of
one."""


def estimate_mass(trace: Trace, conversion: Conversion) -> Estimate:
    """The load's vertical force over g, against the same rests and passes without the object.

    `components` holds the bare mean of F_z/g of the same recording as `single-shot`, and what rests
    and passes say on their own (`rests`, `passes`), in kg.

    Raises:
        ValueError: the recording holds no samples or no held object.
    """
    recording = conversion.recording
    parameter = Parameter(conversion.object, "mass")
    found = segments(trace, recording)
    force = fit_load(found, Z, trace.gravity, trace.hand)
    gain = GAIN_AVERAGE * trace.hand.torque_gain / np.sqrt(3.0)
    return _estimate(parameter, force, gain, found, trace, recording)


def _estimate(
    parameter: Parameter,
    force: Contrast,
    gain: float,
    found: Sequence[Segment],
    trace: Trace,
    recording: Recording,
) -> Estimate:
    g = trace.gravity
    value, std = force.value / g, float(np.hypot(force.std, gain * force.value)) / g
    widen = std / force.std
    low, high = (value + widen * (bound - force.value) for bound in force.ci95)
    if low > 0.0:
        return Estimate(
            parameter,
            (value,),
            (std,),
            ((low, high),),
            _method(found),
            (recording,),
            components=_components(found, trace, recording),
        )
    value, std = _positive(value, std)
    return Estimate(
        parameter,
        (value,),
        (std,),
        ((0.0, max(high, 2.0 * value)),),
        _method(found) + LIGHT,
        (recording,),
        "prior-dominated",
        _components(found, trace, recording),
    )


LIGHT = (
    " The object is too light for this scatter: that a mass is positive says as much as the forces."
)


def _positive(value: float, std: float) -> tuple[float, float]:
    """Mean and standard deviation of a normal, given that it is positive."""
    unit = NormalDist()
    alpha = -value / std
    hazard = unit.pdf(alpha) / max(1.0 - unit.cdf(alpha), 1e-12)
    return value + std * hazard, std * float(np.sqrt(max(1.0 + alpha * hazard - hazard**2, 1e-6)))


def _components(
    found: Sequence[Segment], trace: Trace, recording: Recording
) -> dict[str, tuple[float, float]]:
    bare = trace.of(recording).wrench[:, Z]
    parts = {"single-shot": (float(bare.mean()) / trace.gravity, float(bare.std()) / trace.gravity)}
    for name, still in (("rests", True), ("passes", False)):
        group = [s for s in found if s.at_rest == still]
        if referenced(group):
            force = fit_load(group, Z, trace.gravity, trace.hand)
            parts[name] = (force.value / trace.gravity, force.std / trace.gravity)
    return parts


def _method(found: Sequence[Segment]) -> str:
    if not referenced(found):
        return (
            "Mean vertical force while held still, over g; no unloaded pass or rest at the same pose was "
            "recorded, so the arm's own bias is only bounded by its datasheet."
        )
    counts = {
        (still, loaded): sum(s.at_rest == still and s.loaded == loaded for s in found)
        for still in (True, False)
        for loaded in (True, False)
    }
    return (
        f"Vertical force with the object less without it, over g: {counts[True, True]} loaded against "
        f"{counts[True, False]} empty rests and {counts[False, True]} loaded against {counts[False, False]} "
        "empty passes over the same path in the same direction, weighted by their scatter."
    )
