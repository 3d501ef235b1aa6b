"""Stiffness of a compliant surface: a mat, a cloth, a cushion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import ClassVar

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.agreement import FitTest, chi_squared
from palpate.estimation.contact.descent import probes
from palpate.estimation.contact.spring import Spring, spring_view
from palpate.estimation.contact.touch import Touch, touches_of
from palpate.estimation.estimate import Z95, Estimate, Part, Shared, not_identified
from palpate.mjcf.body import Body
from palpate.parameter import Parameter
from palpate.quantities.height import TOUCH
from palpate.quantities.quantity import Quantity
from palpate.trace.samples import Trace

UNIT = "N/m"


class Stiffness(Quantity):
    """Force over depth of what both fingertips press on. MuJoCo has no number for it; the twin has
    it in `<custom>`."""

    id = "stiffness"
    unit = UNIT
    subject = "surface"
    words: ClassVar = {
        "en": ("stiffness", "stiff", "softness", "soft", "springiness", "firmness", "compliance"),
        "de": ("steifigkeit", "steifheit", "federsteifigkeit", "nachgiebigkeit"),
        "es": ("rigidez",),
        "fr": ("rigidité", "raideur"),
        "it": ("rigidezza", "rigidità"),
    }
    evidence = (TOUCH,)
    derived = True
    estimators: ClassVar = {"spring": "palpate.quantities.stiffness:estimate_stiffness"}


def estimate_stiffness(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Stiffness of a surface from every guarded descent on it, and `first contact` (world z, m).

    The compliance is estimated; the interval of the stiffness is the reciprocal of its interval.

    Raises:
        ValueError: a recording holds no samples, or no guarded descent comes before it.
    """
    recordings = tuple(probes(trace, parameter))
    touches = touches_of(trace, recordings)
    found = [touch.spring for touch in touches]
    if not found:
        nothing = f"No descent pressed on {parameter.object}."
        return not_identified(parameter, UNIT, nothing, recordings)
    common = trace.hand.tip_compliance_std
    # The compliance of the tips is in every touch: it is no noise that a mean averages.
    own = [float(np.sqrt(spring.compliance_std**2 - common**2)) for spring in found]
    weights = np.array(own) ** -2.0
    compliances = np.array([spring.compliance for spring in found])
    mean = float(np.average(compliances, weights=weights))
    std = float(np.hypot(weights.sum() ** -0.5, common))
    most = max(spring.at_most(2.0) for spring in found)
    if most < tuning.RIGID or mean < std / tuning.RESOLVED:
        stiffer = 1.0 / (most if most < tuning.RIGID else max(mean, 0.0) + Z95 * std)
        rounded = f"{float(f'{stiffer:.2g}'):.0f}"  # two digits
        reason = (
            f"What stopped the fingertips on {parameter.object} is stiffer than {rounded} N/m, as "
            "stiff as a table: pressing with the fingertips does not resolve it."
        )
        return not_identified(parameter, UNIT, reason, recordings)
    misfit = float(np.sum(weights * (compliances - mean) ** 2))
    ends = (1.0 / (mean + Z95 * std), 1.0 / (mean - Z95 * std))
    times = "" if len(found) == 1 else f", {len(found)} times"
    first = float(np.mean([spring.first for spring in found]))
    first_std = float(np.hypot(trace.hand.tip_offset_std, trace.hand.pose_repeatability))
    return Estimate(
        parameter,
        UNIT,
        values=np.array([1.0 / mean]),
        stds=np.array([(ends[1] - ends[0]) / (2.0 * Z95)]),
        intervals=np.array([ends]),
        method=f"Slope of the force over the fingertips' depth as both pressed on it{times}, with the arm's "
        "inertia and friction and what the surface dissipates taken out.",
        evidence=recordings,
        parts={"first contact": Part(first, first_std, "m")},
        tests=tuple(spring_tests(found, touches, misfit)),
        # Error propagation of k = 1/c.
        shared=(Shared("what the fingertips give way", "arm", (common / mean**2,)),),
        views=tuple(
            spring_view(touch.spring, mean, trace.hand.tip_compliance, touch.recording.start)
            for touch in touches
        ),
    )


def spring_tests(
    found: Sequence[Spring], touches: Sequence[Touch], misfit: float
) -> Iterator[FitTest]:
    """Goodness-of-fit tests of one linear spring under both fingers."""
    yield FitTest(
        "one spring",
        max(spring.unevenness for spring in found),
        1.0,
        "The force does not rise in proportion to the depth: it is not one even spring.",
    )
    yield FitTest(
        "held against pressed",
        max(spring.flow for spring in found),
        tuning.BEYOND_DOUBT,
        "Held at rest it is deeper than the spring that fits the pressing: it flows, or is softer where it "
        "is met.",
    )
    for touch in touches:
        yield from touch.sides()
    if len(found) > 1:
        finding = "It is not equally stiff at all the places that were touched."
        yield chi_squared("touch against touch", misfit, len(found) - 1, finding)
