"""Height of a surface: of what is rigid under the fingertips, from a guarded descent."""

from __future__ import annotations

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.contact import Stiff, Touch, touched
from palpate.estimation.estimate import Estimate, Part, not_measured
from palpate.mjcf.body import Body
from palpate.parameter import Parameter
from palpate.trace.recording import Hand
from palpate.trace.samples import Trace

UNIT = "m"


def estimate_height(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """World z of the rigid surface under the fingertips.

    `parts`: `penetration` (how far the pressed tip was below it) and, when the force began to rise
    earlier, `soft onset` (world z). A surface that still gives way under the full force is
    `prior-dominated`.

    Raises:
        ValueError: the recording holds no samples, or no guarded descent comes before it.
    """
    recording = trace.converted(parameter)
    if recording is None:
        return not_measured(parameter, UNIT)
    touch = touched(trace, recording)
    stiff = touch.stiff
    penetration = stiff.compliance * max(touch.full - stiff.knee, 0.0)
    parts = {"penetration": Part(penetration, tuning.CORRECTION * penetration, UNIT)}
    if touch.soft is not None:
        parts["soft onset"] = Part(touch.soft, tuning.SOFT_ACCURACY, UNIT)
    return Estimate.normal(
        parameter,
        UNIT,
        stiff.height,
        _std(touch, penetration, trace.hand),
        _method(touch),
        (recording,),
        "identified" if stiff.rigid else "prior-dominated",
        parts,
    )


def _std(touch: Touch, penetration: float, hand: Hand) -> float:
    """m: of the pose, of the line, of its way back to no force, and of the force it starts from."""
    stiff = touch.stiff
    variance = (
        hand.pose_repeatability**2
        + stiff.scatter**2
        + (tuning.CORRECTION * penetration) ** 2
        + (stiff.compliance * hand.force_repeatability) ** 2
    )
    std = float(np.sqrt(variance))
    if stiff.rigid:
        return std
    # What gives way may end anywhere as far below as it has given way so far.
    return max(std, stiff.compliance * touch.full)


def _method(touch: Touch) -> str:
    stiff = touch.stiff
    text = (
        f"Height of the fingertips where the descent was stopped, carried back along the loading curve "
        f"({1e6 * stiff.compliance:.0f} µm/N, pressed with {touch.full:.1f} N) to its beginning"
    )
    if not stiff.rigid:
        return text + "; it still gives way under the full force, so nothing rigid was reached."
    return text + _softly(stiff, touch.soft) + "."


def _softly(stiff: Stiff, soft: float | None) -> str:
    if soft is None:
        return ""
    thickness = 1e3 * (soft - stiff.height)
    return f"; something soft above it, {thickness:.0f} mm thick, was pressed through"
