"""Stiffness, damping and restitution of a compliant surface: a mat, a cloth, a cushion.

In the file they are the `solref` of its geoms, with a constant impedance (`mjcf.contacts`), for contacts like those of
the fingertips. MuJoCo scales a contact by the mass of the pressing body and by the number of contact points. It cannot
represent a stiffness in N/m for all bodies.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar

import numpy as np

from palpate.common.parameter import Parameter
from palpate.estimation.descent import SOFT, probes
from palpate.estimation.estimate import (
    Z95,
    Estimate,
    FitTest,
    FurtherValue,
    Shared,
    chi_squared,
    not_identified,
)
from palpate.estimation.quantities.height import TOUCH
from palpate.estimation.quantities.quantity import Quantity, Status
from palpate.estimation.spring import (
    BEYOND_DOUBT,
    Spring,
    damping_ratio,
    damping_view,
    restitution,
    spring_view,
)
from palpate.estimation.touch import RIGID, SurfaceTouch, touches_of
from palpate.mjcf.body import Body, BodyDescription
from palpate.mjcf.contacts import damp_surface, find_softness_override, soften_surface, spring_of
from palpate.mjcf.edits import Edit
from palpate.trace.recording import NominalHand
from palpate.trace.samples import Trace

RESOLVED = 1.0 / 3.0
"""Largest ratio of a compliance's std to its value at which the stiffness has an upper end. Sensitive: no."""

UNIT, DAMPING_UNIT, RESTITUTION_UNIT = "N/m", "N·s/m", "1"
UNRESOLVED = (
    "it is too little to be told from the arm's friction and inertia at the speed of a touch"
)
WIDEST = 0.5
"""Width of an interval of the restitution, between 0 and 1, above which it is not informative."""


class Stiffness(Quantity):
    """Force over depth of a surface under both fingertips.

    In the file it is the `solref` of its geoms that gives this stiffness under the fingertips.
    """

    id = "stiffness"
    unit = UNIT
    subject = "surface"
    bounds = (0.0, np.inf)
    elsewhere = "spring"
    words: ClassVar = {
        "en": ("stiffness", "stiff", "softness", "soft", "springiness", "firmness", "compliance"),
        "de": ("steifigkeit", "steifheit", "federsteifigkeit", "nachgiebigkeit"),
        "es": ("rigidez",),
        "fr": ("rigidité", "raideur"),
        "it": ("rigidezza", "rigidità"),
    }
    evidence = (TOUCH,)
    derived = True
    estimators: ClassVar = {"spring": "palpate.estimation.quantities.stiffness:estimate_stiffness"}

    def status(self, body: BodyDescription) -> Status:
        """Known where a direct `solref` makes its contact a linear spring."""
        return "not applicable" if spring_of(body) is None else "known"

    def compiled(self, body: BodyDescription) -> tuple[float, ...] | None:
        spring = spring_of(body)
        return None if spring is None else spring[:1]

    def write(
        self, body: BodyDescription, value: tuple[float, ...], std: float | None
    ) -> Iterator[Edit]:
        yield from soften_surface(body, value[0], std)

    def overruled(self, body: BodyDescription) -> str:
        return find_softness_override(body)


class ContactDamping(Quantity):
    """Damping of a compliant surface under both fingertips: force over their downward speed."""

    id = "contact_damping"
    unit = DAMPING_UNIT
    subject = "surface"
    bounds = (0.0, np.inf)
    label = "contact damping"
    words: ClassVar = {
        "en": ("contact damping", "dissipation"),
        "de": ("kontaktdämpfung",),
        "es": ("amortiguamiento del contacto",),
        "fr": ("amortissement du contact",),
        "it": ("smorzamento del contatto",),
    }
    how = "as stiffness"
    evidence = (TOUCH,)
    derived = True
    estimators: ClassVar = {"spring": "palpate.estimation.quantities.stiffness:estimate_damping"}

    def needs(self, body: Body, bodies: Mapping[str, Body]) -> Iterator[Parameter]:
        """Its stiffness, without which damping has no effect."""
        if "stiffness" not in body.known:
            yield Parameter(body.name, "stiffness")

    def status(self, body: BodyDescription) -> Status:
        return "not applicable" if spring_of(body) is None else "known"

    def compiled(self, body: BodyDescription) -> tuple[float, ...] | None:
        spring = spring_of(body)
        return None if spring is None else spring[1:]

    def write(
        self, body: BodyDescription, value: tuple[float, ...], std: float | None
    ) -> Iterator[Edit]:
        yield from damp_surface(body, value[0], std)

    def overruled(self, body: BodyDescription) -> str:
        if spring_of(body) is None:
            return "it acts together with a stiffness alone, which was not measured"
        return find_softness_override(body)


class Restitution(Quantity):
    """Fraction of its speed with which a body of 1 kg rebounds from a surface, from stiffness and damping of a press.

    MuJoCo has no number for it that holds for every mass; the twin states it in `<custom>`.
    """

    id = "restitution"
    unit = RESTITUTION_UNIT
    subject = "surface"
    bounds = (0.0, 1.0)
    words: ClassVar = {
        "en": ("restitution", "bounciness", "coefficient of restitution", "bouncy"),
        "de": ("restitution", "restitutionskoeffizient", "stoßzahl", "sprungkraft"),
        "es": ("restitución", "coeficiente de restitución"),
        "fr": ("restitution", "coefficient de restitution", "rebond"),
        "it": ("restituzione", "coefficiente di restituzione", "rimbalzo"),
    }
    how = "as stiffness"
    evidence = (TOUCH,)
    derived = True
    estimators: ClassVar = {
        "spring": "palpate.estimation.quantities.stiffness:estimate_restitution"
    }


def estimate_stiffness(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Stiffness of a surface from every guarded descent on it, with `first contact` (world z, m).

    The compliance is estimated. The interval of the stiffness is the reciprocal of its interval.
    Raises ValueError: A recording holds no samples, or no guarded descent comes before it.
    """
    recordings = tuple(probes(trace, parameter))
    touches = touches_of(trace, recordings)
    found = [touch.spring for touch in touches]
    if not found:
        nothing = f"No descent pressed on {parameter.object}."
        return not_identified(parameter, UNIT, nothing, recordings)
    common = trace.hand.tip_compliance_std
    # Tip compliance is common to all touches: average the rest by inverse variances.
    own = [float(np.sqrt(spring.compliance_std**2 - common**2)) for spring in found]
    weights = np.array(own) ** -2.0
    compliances = np.array([spring.compliance for spring in found])
    mean = float(np.average(compliances, weights=weights))
    std = float(np.hypot(weights.sum() ** -0.5, common))
    most = max(spring.at_most(2.0) for spring in found)
    # As stiff as a table, a support counts as one below a soft layer, unless it was met at the surface's own top.
    is_table = most < RIGID and not all(met_at_top(touch, body, trace.hand) for touch in touches)
    if is_table or mean < std / RESOLVED:
        stiffer = 1.0 / (most if is_table else max(mean, 0.0) + Z95 * std)
        rounded = f"{float(f'{stiffer:.2g}'):.0f}"  # two digits
        reason = (
            f"What stopped the fingertips on {parameter.object} is stiffer than {rounded} N/m, as "
            "stiff as a table: pressing with the fingertips does not resolve it."
        )
        return not_identified(parameter, UNIT, reason, recordings)
    # Ends of the interval: reciprocals of the compliance's ends.
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
        parts={
            "first contact": FurtherValue(first, first_std, "m"),
            "depth": FurtherValue(
                min(s.deepest for s in found), trace.hand.pose_repeatability, "m"
            ),
        },
        tests=tuple(spring_tests(found, touches, misfit)),
        # Error propagation of k = 1/c.
        shared=(Shared("what the fingertips give way", "arm", (common / mean**2,)),),
        views=tuple(
            spring_view(touch.spring, mean, trace.hand.tip_compliance, touch.recording.start)
            for touch in touches
        ),
    )


def met_at_top(touch: SurfaceTouch, body: Body | None, hand: NominalHand) -> bool:
    """True if the fingertips stopped at the surface's top as the scene states it.

    Then no soft layer lies above the stop, whether its force was measurable or not.
    """
    if body is None or "height" in body.missing or touch.pressed_through:
        return False
    return body.top_z() - touch.first < SOFT + 2.0 * hand.tip_offset_std


def spring_tests(
    found: Sequence[Spring], touches: Sequence[SurfaceTouch], misfit: float
) -> Iterator[FitTest]:
    """Yield goodness-of-fit tests of one linear spring under both fingers."""
    # Constant stiffness over depth, and the same depth at rest as under load.
    yield FitTest(
        "one spring",
        max(spring.unevenness for spring in found),
        1.0,
        "The force does not rise in proportion to the depth: it is not one even spring.",
    )
    yield FitTest(
        "held against pressed",
        max(spring.flow for spring in found),
        BEYOND_DOUBT,
        "Held at rest it is deeper than the spring that fits the pressing: it flows, or is softer where it "
        "is met.",
    )
    for touch in touches:
        yield from touch.sides()
    if len(found) > 1:
        finding = "It is not equally stiff at all the places that were touched."
        yield chi_squared("touch against touch", misfit, len(found) - 1, finding)


def estimate_damping(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Damping of a surface from every guarded descent on it.

    It is the force that depends on speed and not on depth.
    Raises ValueError: A recording holds no samples, or no guarded descent comes before it.
    """
    spring = estimate_stiffness(trace, Parameter(parameter.object, "stiffness"), body)
    if not spring.has_value:
        return not_identified(parameter, DAMPING_UNIT, spring.method, spring.evidence)
    # Average the dampings of all touches.
    touches = touches_of(trace, spring.evidence)
    value, std = mean_damping([touch.spring for touch in touches])
    return Estimate.normal(
        parameter,
        DAMPING_UNIT,
        value,
        std,
        "Force that comes with the speed of the fingertips as they sink in, and not with their depth, with the arm's "
        "inertia and friction taken out.",
        spring.evidence,
        tests=spring.tests,
        views=tuple(damping_view(t.spring, value, t.recording.start) for t in touches),
        reason="" if value >= std / RESOLVED else UNRESOLVED,
    )


def mean_damping(found: Sequence[Spring]) -> tuple[float, float]:
    """Weighted mean of the dampings of several touches, N s/m, and its standard deviation."""
    stds = np.array([spring.damping_std for spring in found])
    value = np.average([spring.damping for spring in found], weights=stds**-2.0)
    # Drift in free air is similar in all descents of an arm: a mean halves it at most.
    return float(value), max(float(np.sum(stds**-2.0)) ** -0.5, float(stds.min()) / 2.0)


def estimate_restitution(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Coefficient of restitution of a body of 1 kg from the stiffness and damping of the surface.

    Raises ValueError: A recording holds no samples, or no guarded descent comes before it.
    """
    spring = estimate_stiffness(trace, Parameter(parameter.object, "stiffness"), body)
    if not spring.has_value:
        reason = (
            f"{spring.method} A body is thrown back by it within a few milliseconds, too fast for the arm's samples, "
            "and the fingertips give way more than it does."
        )
        return not_identified(parameter, RESTITUTION_UNIT, reason, spring.evidence)
    # Damping ratio of the reference mass on the surface, with its error.
    touches = touches_of(trace, spring.evidence)
    damping, std = mean_damping([touch.spring for touch in touches])
    stiffness = float(spring.values[0])
    # zeta = d / (2 sqrt(k m)): the relative error of k counts by half.
    doubt = Z95 * float(np.hypot(std, damping * float(spring.stds[0]) / stiffness / 2.0))
    least, most = (
        restitution(damping_ratio(stiffness, one)) for one in (damping + doubt, damping - doubt)
    )
    # A wide interval within the physical range carries no information.
    possible = min(most, 1.0)
    if possible - least > WIDEST:
        reason = (
            f"A body of 1 kg returns from {parameter.object} with {least:.2f} to {possible:.2f} of its speed: what it "
            "dissipates is not told well enough from the arm's friction and inertia."
        )
        return not_identified(parameter, RESTITUTION_UNIT, reason, spring.evidence)
    # Value, and its derivative by the damping for the chart.
    value = restitution(damping_ratio(stiffness, damping))
    step = restitution(damping_ratio(stiffness, damping + std)) - value
    return Estimate(
        parameter,
        RESTITUTION_UNIT,
        values=np.array([value]),
        stds=np.array([(most - least) / (2.0 * Z95)]),
        intervals=np.array([(least, most)]),
        method="Share of its speed with which a body of 1 kg that touches as the fingertips do would return, from the "
        "stiffness and the damping of a slow press, if they hold at the speed of a fall.",
        evidence=spring.evidence,
        tests=spring.tests,
        views=tuple(
            damping_view(t.spring, damping, t.recording.start, std / step) for t in touches
        ),
    )
