"""Coulomb friction between a held object and its support, from drags."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from palpate.common.parameter import Parameter
from palpate.estimation.breakaway import static_friction
from palpate.estimation.drag_causes import AXES, HOLDS, LEAN, PLACES, SPEED
from palpate.estimation.drags import ROUGH, Drag, steady_drags
from palpate.estimation.estimate import (
    AS_WIDE,
    Estimate,
    FitTest,
    FurtherValue,
    chi_squared,
    not_identified,
)
from palpate.estimation.friction_fit import Sliding, fit_sliding, fit_whole
from palpate.estimation.load_equations import FORCE_BIAS
from palpate.estimation.quantities.quantity import Evidence, Prior, Quantity, Status, Values
from palpate.estimation.weighing import WHOLE_APART, hangs_free
from palpate.estimation.wrench_observation import observe_wrench
from palpate.mjcf.body import Body, BodyDescription
from palpate.mjcf.contacts import (
    acting_friction,
    find_friction_override,
    highest_priority,
    standing_contacts,
    static_pairs,
)
from palpate.mjcf.document import UNKNOWN, Element, has_unknown, tokens
from palpate.mjcf.edits import Edit, Slot, number
from palpate.mjcf.elements import MUJOCO_FRICTION, MUJOCO_PAIR_FRICTION, Elements
from palpate.trace.samples import FORCES, Trace

FRICTION_RANGE = 1.0
"""1 sigma of a variation of the coefficient, in the tests for one. Sensitive: no."""
HELD_RANGE = 10.0
"""N (1 sigma) of a holding force, in the test for one. Sensitive: no."""
STICKING = 0.1
"""Fraction of the rows of steady sliding in which the hand may lag its command. Stick-slip holds it back most of the
time. Sensitive: no."""
LIKELY_FRICTION = 2.0
"""Largest coefficient of dry friction that is plausible. Sensitive: no."""
SIGNIFICANT = 2.0
"""Standard deviations above zero from which a friction is identified. Sensitive: no."""
ALIKE_FRICTION = 0.05
"""Relative variation (1 sigma) of a coefficient with direction, place and speed that is tolerated. Sensitive: no."""

UNIT = "1"
PRIOR_FRICTION = 0.5
"""Prior mean: household objects on wood and plastics."""
PRIOR_SPREAD = 0.15
"""1 sigma of the prior."""
TRUE_FRICTION = (0.25, 0.7)
"""Range of a hidden friction coefficient."""


class Friction(Quantity):
    """Sliding friction of an object: the first number of `friction`, the dynamic coefficient."""

    id = "friction"
    unit = UNIT
    subject = "object"
    bounds = (0.0, np.inf)
    label = "sliding friction"
    elsewhere = "frictionloss"
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
    estimators: ClassVar = {"drag": "palpate.estimation.quantities.friction:estimate_friction"}

    def status(self, body: BodyDescription) -> Status:
        """Status by the explicit contact pairs where they apply, unless a geom has a `?`."""
        pairs, geoms = static_pairs(body), open_geoms(body)
        if pairs and not any(has_unknown(geom, "friction", 0) for geom in geoms):
            return "missing" if open_pairs(body, pairs) else "known"
        return "missing" if geoms else "known"

    def known(self, body: BodyDescription) -> tuple[float, ...]:
        # Explicit pairs decide; otherwise the largest coefficient of the colliding geoms.
        acting = acting_friction(body) if static_pairs(body) else None
        if acting is not None:
            return (acting,)
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
        """Write with a `priority` above that of all static geoms, and into explicit pairs with them.

        Otherwise MuJoCo would take the larger coefficient of object and support, or the support's.
        """
        text, above = number(value[0], std), highest_priority(body) + 1
        for geom in open_geoms(body) or body.elements.colliding:
            base = body.defaults.attribute(geom, "friction") or " ".join(MUJOCO_FRICTION)
            # Other open numbers, for torsional and rolling friction, take MuJoCo's defaults.
            defaults = zip(tokens(base)[:3], MUJOCO_FRICTION, strict=False)
            numbers = {i: usual for i, (part, usual) in enumerate(defaults) if part == UNKNOWN}
            yield Edit(geom, "friction", {**numbers, 0: text}, base)
            if int(body.defaults.attribute(geom, "priority") or 0) < above:
                yield Edit(geom, "priority", {0: str(above)}, "0")
        pairs = static_pairs(body)
        for pair in open_pairs(body, pairs) or pairs:
            base = body.defaults.attribute(pair, "friction") or MUJOCO_PAIR_FRICTION
            # A pair has one coefficient for each of two directions; the second may be omitted.
            both = {0: text, 1: text} if len(tokens(base)) > 1 else {0: f"{text} {text}"}
            yield Edit(pair, "friction", both, base)

    def compiled(self, body: BodyDescription) -> tuple[float, ...] | None:
        """Friction of the contact with the support, which a slide measures.

        Without a support it is the object's own. It is None where several coefficients act.
        """
        if not standing_contacts(body):
            return self.known(body)
        acting = acting_friction(body)
        return None if acting is None else (acting,)

    def overruled(self, body: BodyDescription) -> str:
        return find_friction_override(body)


def open_geoms(body: BodyDescription) -> tuple[Element, ...]:
    """Geoms with sliding friction `?`; if no geom states any friction, all colliding geoms."""
    geoms = body.elements.colliding
    stated = {geom: tokens(body.defaults.attribute(geom, "friction")) for geom in geoms}
    marked = tuple(geom for geom, parts in stated.items() if parts[:1] == [UNKNOWN])
    if marked or any(stated.values()):
        return marked
    return geoms


def open_pairs(body: BodyDescription, pairs: Iterable[Element]) -> tuple[Element, ...]:
    """Explicit `pairs` without a stated friction."""
    return tuple(pair for pair in pairs if body.defaults.attribute(pair, "friction") is None)


def estimate_friction(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Sliding friction of an object on its support from all drags in the trace, also those on the way back.

    The value is the dynamic coefficient; `parts` holds `static` and `dynamic`, and the `normal force`.
    """
    slides = [r for r in trace.recordings if r.context.activity == "sliding"]
    evidence = tuple(r for r in slides if r.context.holding == parameter.object)
    observed = observe_wrench(trace)
    drags = steady_drags(trace, parameter.object, observed)
    if not drags:
        return not_identified(
            parameter,
            UNIT,
            "No recording shows the held object sliding steadily along its support.",
            evidence,
        )
    found = fit_sliding(drags, observed, trace.hand)
    normal = np.concatenate([drag.normal[drag.steady] for drag in drags])
    # Drags are referred to the object hanging in the air, so the tests include that it hangs free there.
    tests = (*friction_tests(drags, found), *hangs_free(trace, parameter.object))
    value, std = found.friction
    whole = None
    if all(test.passed for test in tests):
        # The fit to all motion around the drags replaces the fit of the drags alone if it is more precise and
        # agrees with it.
        whole = fit_whole(trace, parameter.object, drags, observed, value)
        if whole is not None and not (
            whole.explains and whole.std < std and abs(whole.friction - value) < WHOLE_APART * std
        ):
            whole = None
    if whole is not None:
        value, std = whole.friction, whole.std
    method = drag_method(len(drags), float(normal.min()), float(normal.max()), whole is not None)
    names = sorted({recording.context.support or "" for recording in evidence} - {""})
    method += f" It is the coefficient of the pair with {' and '.join(names)}." if names else ""
    parts = {
        "dynamic": FurtherValue(value, std),
        "normal force": FurtherValue(float(normal.mean()), float(normal.std()), "N"),
    }
    fit = found if whole is None else found.knowing(value, std)
    # Breakaway and sliding are distinguishable only with significant friction.
    static = static_friction(drags, fit) if value > SIGNIFICANT * std else None
    if static is not None:
        parts["static"] = FurtherValue(*static)
    made = Estimate.normal(
        parameter,
        UNIT,
        value,
        std,
        method,
        evidence,
        parts=parts,
        tests=tests,
        views=tuple(fit.views(drags, static)),
        reason="" if std < PRIOR_SPREAD else AS_WIDE,
    )
    return replace(made, shared=found.shared if whole is None else whole.shared)


def friction_tests(drags: Sequence[Drag], found: Sliding) -> tuple[FitTest, ...]:
    """Goodness-of-fit tests of Coulomb friction with one coefficient."""
    # Fraction of rows in which the hand does not follow its command.
    held = sum(int(np.sum(drag.swung_out & ~drag.moving)) for drag in drags)
    rows = sum(int(drag.swung_out.sum()) for drag in drags)
    value, std = found.friction

    def test_equal_friction(cause: str, name: str, where: str) -> FitTest:
        """Test for equal friction in two subsets; a few per cent of difference are tolerated."""
        return found.test(
            cause,
            FRICTION_RANGE,
            ALIKE_FRICTION * value,
            name,
            lambda size: f"Friction differs by {2 * size:.2g} {where}.",
        )

    return (
        chi_squared(
            "one coefficient everywhere",
            found.disagreement,
            found.freedom,
            f"The sliding force is {found.misfit:.2g} N (rms) off what one coefficient makes of the "
            "normal force: friction differs along the way, or something else pulls.",
        ),
        test_equal_friction(
            AXES, "one axis against the other", "between axes, or it slips in the fingers"
        ),
        test_equal_friction(
            LEAN, "one way against the other", "from one way to the other, or something pulls"
        ),
        test_equal_friction(PLACES, "one place against the others", "along the way"),
        test_equal_friction(SPEED, "slow against fast", "where it slides twice as fast"),
        found.test(
            HOLDS,
            HELD_RANGE,
            FORCE_BIAS,
            "force without pressure",
            lambda size: (
                f"{size:.2g} N of the sliding force do not grow with the normal force: something else "
                "holds the object (a magnet, something sticky), or it slips in the fingers."
            ),
        ),
        FitTest(
            "steady sliding",
            held / max(rows, 1),
            STICKING,
            "The object sticks and slips: no force is that of steady sliding.",
        ),
        FitTest(
            "smooth sliding",
            max(drag.roughness for drag in drags),
            ROUGH,
            "The object chatters: the sliding force is that of sticking in between.",
        ),
        FitTest(
            "a likely coefficient",
            value - SIGNIFICANT * std,
            LIKELY_FRICTION,
            "Nothing dry is so rough: something holds the object.",
        ),
    )


def drag_method(drags: int, least: float, most: float, whole: bool) -> str:
    """Describe the drags, their range of normal force, N, and the reference of the forces."""
    number = f"{drags} drag{'s' * (drags > 1)}"
    how = f"Growth of the tangential force with the normal force in {number}"
    reference = "both measured against the object hanging free"
    if whole:
        how = f"Ratio of the tangential force to the normal force in {number}"
        reference = "both measured against all motion of the arm in free air around them"
    return (
        f"{how} under {least:.1f} to {most:.1f} N, {reference}; "
        "static at breakaway, dynamic while sliding steadily."
    )
