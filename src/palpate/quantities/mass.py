"""Mass of a held object."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.estimate import Estimate, not_identified, not_measured
from palpate.estimation.segments import Segment, referenced
from palpate.estimation.weighing import alone, single_shot, weigh
from palpate.mjcf.body import Body
from palpate.parameter import Parameter
from palpate.trace.samples import Trace

UNIT = "kg"


def estimate_mass(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """The load's vertical force over g, against the same rests and passes without the object.

    `parts` holds the bare mean of F_z/g of the same recording as `single-shot`, and what rests and
    passes say on their own (`rests`, `passes`).

    Raises:
        ValueError: the recording holds no samples or no held object.
    """
    recording = trace.converted(parameter)
    if recording is None:
        return not_measured(parameter, UNIT)
    weight = weigh(trace, recording)
    parts = {"single-shot": single_shot(trace, recording), **alone(trace, weight.segments)}
    method = _method(weight.segments)
    if weight.verdict == "prior-dominated":
        method += LIGHT
    return Estimate(
        parameter,
        UNIT,
        np.array([weight.mass]),
        np.array([weight.std]),
        np.array([weight.ci95]),
        method,
        (recording,),
        weight.verdict,
        parts,
    )


LIGHT = (
    " The object is too light for this scatter: that a mass is positive says as much as the forces."
)


def estimate_single_shot(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """The paper's Force2Mass: the mean of F_z / g while the object is held still.

    Nothing is compared with the empty hand, so what the arm reads without any load is part of the
    result, and its bound part of the standard deviation.
    """
    recording = trace.converted(parameter)
    if recording is None:
        return not_measured(parameter, UNIT)
    mean = single_shot(trace, recording)
    if not mean.value > 0.0:
        return not_identified(parameter, UNIT, "The held object did not pull down.", (recording,))
    std = np.hypot(mean.std, tuning.FORCE_BIAS / trace.gravity)
    method = (
        "Mean vertical force while held still, over g; not compared with the empty hand, so the "
        "arm's own bias is only bounded."
    )
    return Estimate.normal(parameter, UNIT, mean.value, std, method, (recording,), least=0.0)


def _method(found: Sequence[Segment]) -> str:
    if not referenced(found):
        return (
            "Mean vertical force while held still, over g; no unloaded pass or rest at the same pose was "
            "recorded, so the arm's own bias is only bounded by its datasheet."
        )
    count = Counter((segment.at_rest, segment.loaded) for segment in found)
    return (
        f"Vertical force with the object less without it, over g: {count[True, True]} loaded against "
        f"{count[True, False]} empty rests and {count[False, True]} loaded against {count[False, False]} "
        "empty passes over the same path in the same direction, weighted by their scatter."
    )
