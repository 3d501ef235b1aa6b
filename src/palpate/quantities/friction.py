"""Coulomb friction between a held object and what it is dragged along."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.agreement import FitTest, chi_squared
from palpate.estimation.estimate import Estimate, Part, not_identified
from palpate.estimation.friction.breakaway import static_friction
from palpate.estimation.friction.columns import AXES, HELD, PLACES, SPEED, WAYS
from palpate.estimation.friction.drags import Drag, steady_drags
from palpate.estimation.friction.fit import Sliding, fit_sliding
from palpate.estimation.friction.whole import Whole, fit_whole
from palpate.estimation.load.observation import WrenchObservation, observe
from palpate.estimation.load.weighing import hangs_free
from palpate.geometry.pose import Array
from palpate.mjcf.body import Body, BodyDescription
from palpate.mjcf.defaults import MUJOCO_FRICTION
from palpate.mjcf.document import UNKNOWN, Element, tokens
from palpate.mjcf.edits import Edit, Slot, number
from palpate.mjcf.roles.elements import Elements
from palpate.parameter import Parameter
from palpate.quantities.contacts import highest_priority, pair_friction, what_decides
from palpate.quantities.evidence import Evidence
from palpate.quantities.quantity import Prior, Quantity, Status, Values
from palpate.trace.recording import Recording
from palpate.trace.samples import FORCES, Trace

UNIT = "1"

PRIOR_FRICTION = 0.5
"""Of household things on wood and plastics."""

PRIOR_SPREAD = 0.15
"""1 sigma."""

TRUE_FRICTION = (0.25, 0.7)
"""Range in which a hidden friction is drawn."""


class Friction(Quantity):
    """Sliding friction of an object: the first number of `friction`, the dynamic coefficient."""

    id = "friction"
    unit = UNIT
    subject = "object"
    label = "sliding friction"
    words: ClassVar = {
        "en": ("friction", "slipperiness", "slippery", "grip", "mu"),
        "de": ("reibung", "reibungskoeffizient", "reibungszahl", "reibwert", "haftung"),
        "es": ("fricción", "rozamiento", "coeficiente de fricción", "coeficiente de rozamiento"),
        "fr": ("frottement", "frottements", "friction", "coefficient de frottement"),
        "it": ("attrito", "coefficiente di attrito", "frizione"),
    }
    evidence = (
        Evidence(
            FORCES, "MeasureForces while held still in the air", activity=("still",), holding=True
        ),
        Evidence(
            FORCES,
            "in a Parallel with a MovePose that slides the held object along its support",
            activity=("sliding",),
            holding=True,
            distinct="place",
            better=2,
        ),
    )
    derived = True
    estimators: ClassVar = {"drag": "palpate.quantities.friction:estimate_friction"}

    def status(self, body: BodyDescription) -> Status:
        return "missing" if _lacking(body) else "known"

    def known(self, body: BodyDescription) -> tuple[float, ...]:
        ids = [body.shapes.geom_ids[geom] for geom in body.elements.colliding]
        return (float(max(body.shapes.model.geom_friction[i][0] for i in ids)),)

    def slots(self, elements: Elements) -> Iterator[Slot]:
        for geom in elements.geoms:
            yield Slot(geom, "friction", "1")

    def prior(self, body: BodyDescription, believed: Values) -> Prior:
        return Prior((PRIOR_FRICTION,), (PRIOR_SPREAD,))

    def draw(self, body: Body, prior: Prior, random: np.random.Generator) -> tuple[float, ...]:
        return (float(random.uniform(*TRUE_FRICTION)),)

    def write(
        self, body: BodyDescription, value: tuple[float, ...], std: float | None
    ) -> Iterator[Edit]:
        """With a `priority` above that of all that stands still, without which MuJoCo would take the
        larger of the object's and its support's coefficient, or the support's."""
        text, above = number(value[0], std), highest_priority(body) + 1
        for geom in _lacking(body) or body.elements.colliding:
            base = body.defaults.attribute(geom, "friction") or " ".join(MUJOCO_FRICTION)
            numbers = {
                i: MUJOCO_FRICTION[i] for i, part in enumerate(tokens(base)[:3]) if part == UNKNOWN
            }
            yield Edit(geom, "friction", {**numbers, 0: text}, base)
            if int(body.defaults.attribute(geom, "priority") or 0) < above:
                yield Edit(geom, "priority", {0: str(above)}, "0")

    def acting(self, body: BodyDescription, stated: tuple[float, ...]) -> tuple[float, ...]:
        """Friction of the pair with the support, which a slide measures."""
        pair = pair_friction(body)
        return stated if pair is None else (pair,)

    def overruled(self, body: BodyDescription) -> str:
        return what_decides(body)


def _lacking(body: BodyDescription) -> tuple[Element, ...]:
    """Geoms whose sliding friction is written `?`; when no geom states any, all that can touch."""
    geoms = body.elements.colliding
    stated = {geom: tokens(body.defaults.attribute(geom, "friction")) for geom in geoms}
    marked = tuple(geom for geom, parts in stated.items() if parts[:1] == [UNKNOWN])
    if marked or any(stated.values()):
        return marked
    return geoms


def estimate_friction(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Sliding friction of an object on its support from every drag in the trace, recorded or on
    the way back.

    The value is the dynamic coefficient; `parts` holds `static` and `dynamic`, and the `normal
    force`.
    """
    evidence = _sliding(trace, parameter.object)
    observed = observe(trace)
    drags = steady_drags(trace, parameter.object, observed)
    if not drags:
        return not_identified(
            parameter,
            UNIT,
            "No recording shows the held object sliding steadily along its support.",
            evidence,
        )
    found = fit_sliding(drags, observed, trace.hand)
    normal = _normal_forces(drags)
    # What pulls on the object in the air pulls on what the drags are measured against.
    tests = (*_tests(drags, found), *hangs_free(trace, parameter.object))
    innocent = all(test.passed for test in tests)
    whole = _whole(trace, parameter.object, drags, observed, found) if innocent else None
    value, std = found.friction if whole is None else (whole.friction, whole.std)
    method = _method(len(drags), float(normal.min()), float(normal.max()), whole)
    method += _of_pair(evidence)
    if value <= tuning.SIGNIFICANT * std:
        reasons = [test.finding for test in tests if not test.passed]
        none = f"The result, {value:.2g} ± {std:.2g}, cannot be told from none."
        return not_identified(parameter, UNIT, " ".join([method, none, *reasons]), evidence)

    parts = {
        "dynamic": Part(value, std),
        "normal force": Part(float(normal.mean()), float(normal.std()), "N"),
    }
    fit = found if whole is None else found.knowing(value, std)
    static = static_friction(drags, fit)
    if static is not None:
        parts["static"] = Part(*static)
    # What is no narrower than what was believed before any slide says no more than that.
    verdict = "identified" if std < PRIOR_SPREAD else "prior-dominated"
    made = Estimate.normal(
        parameter,
        UNIT,
        value,
        std,
        method,
        evidence,
        verdict,
        parts,
        least=0.0,
        tests=tests,
        views=tuple(fit.views(drags, static)),
    )
    return replace(made, shared=found.shared if whole is None else whole.shared)


def _whole(
    trace: Trace, name: str, drags: Sequence[Drag], observed: WrenchObservation, found: Sliding
) -> Whole | None:
    """Friction fitted to all motion around the drags, where it is more precise than the contrast of
    the drags' forces and agrees with it; else None."""
    value, std = found.friction
    whole = fit_whole(trace, name, drags, observed, value)
    if whole is None or not whole.explains or whole.std >= std:
        return None
    return whole if abs(whole.friction - value) < tuning.WHOLE_APART * std else None


def _tests(drags: Sequence[Drag], found: Sliding) -> tuple[FitTest, ...]:
    """Goodness-of-fit tests of Coulomb friction with a single coefficient."""
    held = sum(int(np.sum(drag.swung_out & ~drag.moving)) for drag in drags)
    rows = sum(int(drag.swung_out.sum()) for drag in drags)
    value, unsure = found.friction
    return (
        chi_squared(
            "one coefficient everywhere",
            found.disagreement,
            found.freedom,
            f"The sliding force is {found.misfit:.2g} N (rms) off what one coefficient makes of the "
            "normal force: friction differs along the way, or something else pulls.",
        ),
        _alike(
            found, AXES, "one axis against the other", "between axes, or it slips in the fingers"
        ),
        _alike(
            found,
            WAYS,
            "one way against the other",
            "from one way to the other, or something pulls",
        ),
        _alike(found, PLACES, "one place against the others", "along the way"),
        _alike(found, SPEED, "slow against fast", "where it slides twice as fast"),
        _unpressed(found),
        FitTest(
            "steady sliding",
            held / max(rows, 1),
            tuning.STICKING,
            "The object sticks and slips: no force is that of steady sliding.",
        ),
        FitTest(
            "smooth sliding",
            max(drag.roughness for drag in drags),
            tuning.ROUGH,
            "The object chatters: the sliding force is that of sticking in between.",
        ),
        FitTest(
            "a likely coefficient",
            value - tuning.SIGNIFICANT * unsure,
            tuning.LIKELY_FRICTION,
            "Nothing dry is so rough: something holds the object.",
        ),
    )


def _alike(found: Sliding, what: slice, name: str, where: str) -> FitTest:
    """Test for equal friction in two subsets; differences of a few per cent are tolerated."""
    small = tuning.ALIKE_FRICTION * found.friction[0]
    seen = found.difference(what, tuning.FRICTION_RANGE, small)
    finding = f"Friction differs by {2 * seen.size:.2g} {where}."
    return chi_squared(name, seen.statistic, seen.freedom, finding)


def _unpressed(found: Sliding) -> FitTest:
    """Test for a tangential force that does not grow with the normal force."""
    seen = found.difference(HELD, tuning.HELD_RANGE, tuning.FORCE_BIAS)
    return chi_squared(
        "force without pressure",
        seen.statistic,
        seen.freedom,
        f"{seen.size:.2g} N of the sliding force do not grow with the normal force: something else "
        "holds the object (a magnet, something sticky), or it slips in the fingers.",
    )


def _sliding(trace: Trace, name: str) -> tuple[Recording, ...]:
    """Recordings made while the held object was dragged."""
    found: list[Recording] = []
    for recording in trace.recordings:
        context = recording.context
        if context.activity == "sliding" and context.holding == name:
            found.append(recording)
    return tuple(found)


def _normal_forces(drags: Sequence[Drag]) -> Array:
    """(n,) N, in all rows of steady sliding."""
    return np.concatenate([drag.normal[drag.steady] for drag in drags])


def _of_pair(evidence: Sequence[Recording]) -> str:
    """Names of the surfaces with which the coefficient was measured."""
    names = sorted({recording.context.support or "" for recording in evidence} - {""})
    return f" It is the coefficient of the pair with {' and '.join(names)}." if names else ""


def _method(drags: int, least: float, most: float, whole: Whole | None) -> str:
    number = f"{drags} drag{'s' * (drags > 1)}"
    how = f"How the tangential force grows with the normal force in {number}"
    if whole is not None:
        how = f"How much of the normal force the tangential force is in {number}"
    reference = "both measured against the object hanging free"
    if whole is not None:
        reference = "both measured against all that the arm felt in free air around them"
    return (
        f"{how} under {least:.1f} to {most:.1f} N, {reference}; "
        "static at breakaway, dynamic while sliding steadily."
    )
