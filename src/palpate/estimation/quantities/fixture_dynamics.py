"""Dry friction, damping and spring of the joint of a drawer, a door or a window: one fit, three quantities."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from palpate.common.parameter import Parameter
from palpate.estimation.estimate import AS_WIDE, Estimate, FitView, FurtherValue, not_identified
from palpate.estimation.fixture_fit import DAMPING, DRY, INERTIA, SPRING, JointFit, fit_joint
from palpate.estimation.quantities.quantity import Prior, Quantity, Status, Values, held_and_empty
from palpate.mjcf.body import Body, BodyDescription
from palpate.mjcf.document import has_unknown
from palpate.mjcf.edits import Edit, Slot, number
from palpate.mjcf.elements import Elements
from palpate.trace.samples import FORCES, Trace

WHERE = "at its handle"
HOW = "MoveHandle with MeasureForces, at the handle and above"
LEVER = 0.4
"""m. Distance from a hinge to its handle, which converts forces at the handle to moments in the priors."""


class JointQuantity(Quantity):
    """Number of a joint: the `attribute` of its `<joint>`.

    MuJoCo takes 0 for an omitted one. It is measured on request, or where a `?` is written.
    """

    subject = "fixture"
    unit = "N/m"
    bounds = (0.0, np.inf)
    attribute: ClassVar[str]
    per: ClassVar[str] = "N"
    """Unit for a slide, without division by the metre."""
    divided: ClassVar[bool] = True
    believed: ClassVar[tuple[float, float]]
    """Prior mean and standard deviation for a slide; for a hinge, at the handle."""
    drawn: ClassVar[tuple[float, float]]
    """Range of a hidden value, for a slide or at the handle of a hinge."""
    evidence = held_and_empty(FORCES, "MoveHandle", "working", WHERE)
    derived = True

    def status(self, body: BodyDescription) -> Status:
        joint = body.elements.joint
        if joint is None:
            return "not applicable"
        stated = body.defaults.attribute(joint, self.attribute)
        # MuJoCo's default of an omitted attribute is an assumption.
        if stated is None:
            return "assumed"
        return "missing" if has_unknown(joint, self.attribute, 0) else "known"

    def compiled(self, body: BodyDescription) -> tuple[float, ...]:
        joint = body.shapes.model.joint(body.shapes.model.body(body.name).jntadr[0])
        return (float(np.ravel(getattr(joint, self.attribute))[0]),)

    def slots(self, elements: Elements) -> Iterator[Slot]:
        if elements.joint is not None:
            yield Slot(elements.joint, self.attribute, "0", numbers=(0,))

    def prior(self, body: BodyDescription, believed: Values) -> Prior:
        # Scale the prior of a slide to the kind of the joint.
        mean, std = self.scale(body) * np.array(self.believed)
        return Prior((float(mean),), (float(std),))

    def draw(self, body: Body, prior: Prior, random: np.random.Generator) -> tuple[float, ...]:
        scale = prior.mean[0] / self.believed[0]
        return (float(scale * random.uniform(*self.drawn)),)

    def scale(self, body: BodyDescription) -> float:
        """Factor from the number of a slide to that of this joint with the same forces at the handle."""
        joint = body.joint
        if joint is None or joint.is_slide:
            return 1.0
        return LEVER**2 if self.divided else LEVER

    def write(
        self, body: BodyDescription, value: tuple[float, ...], std: float | None
    ) -> Iterator[Edit]:
        assert body.elements.joint is not None
        yield Edit(body.elements.joint, self.attribute, {0: number(value[0], std)}, "0")


class DryFriction(JointQuantity):
    """Dry (Coulomb) friction of a joint, independent of speed: `frictionloss` in MuJoCo, N or N m."""

    id = "frictionloss"
    unit = "N"
    label = "dry friction"
    attribute = "frictionloss"
    how = HOW
    divided = False
    believed = (4.0, 3.0)
    drawn = (1.0, 8.0)
    words: ClassVar = {
        "en": ("frictionloss", "dry friction", "coulomb friction", "joint friction"),
        "de": ("trockenreibung", "gelenkreibung", "coulomb-reibung"),
        "es": ("fricción seca", "rozamiento seco"),
        "fr": ("frottement sec",),
        "it": ("attrito secco",),
    }
    estimators: ClassVar = {
        "passes": "palpate.estimation.quantities.fixture_dynamics:estimate_dry_friction"
    }


class Damping(JointQuantity):
    """Viscous friction of a joint, proportional to its speed, N·s/m or N·m·s/rad."""

    id = "damping"
    elsewhere = "contact_damping"
    unit = "N·s/m"
    attribute = "damping"
    how = HOW
    per = "N·s"
    believed = (8.0, 6.0)
    drawn = (2.0, 20.0)
    words: ClassVar = {
        "en": ("damping", "viscous friction", "damping coefficient"),
        "de": ("dämpfung", "viskose reibung", "dämpfungskonstante"),
        "es": ("amortiguamiento", "amortiguación", "fricción viscosa"),
        "fr": ("amortissement", "frottement visqueux"),
        "it": ("smorzamento", "attrito viscoso"),
    }
    estimators: ClassVar = {
        "passes": "palpate.estimation.quantities.fixture_dynamics:estimate_damping"
    }


class SpringStiffness(JointQuantity):
    """Stiffness of a joint's spring about its `springref`, N/m or N m/rad."""

    id = "spring"
    unit = "N/m"
    label = "spring stiffness"
    attribute = "stiffness"
    how = HOW
    believed = (30.0, 30.0)
    drawn = (0.0, 80.0)
    elsewhere = "stiffness"
    words: ClassVar = {
        "en": ("spring stiffness", "spring constant", "spring rate", "joint stiffness"),
        "de": ("federkonstante", "federrate", "gelenksteifigkeit"),
        "es": ("constante del muelle", "constante elástica"),
        "fr": ("constante de raideur", "constante du ressort"),
        "it": ("costante elastica", "costante della molla"),
    }
    estimators: ClassVar = {
        "passes": "palpate.estimation.quantities.fixture_dynamics:estimate_spring"
    }


def estimate_dry_friction(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Dry friction of a joint from all passes of its handle."""
    return _estimate(trace, parameter, body, DRY, DryFriction())


def estimate_damping(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Damping of a joint from all passes of its handle."""
    return _estimate(trace, parameter, body, DAMPING, Damping())


def estimate_spring(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Stiffness of a joint's spring from all passes of its handle."""
    return _estimate(trace, parameter, body, SPRING, SpringStiffness())


def _estimate(
    trace: Trace, parameter: Parameter, body: Body | None, cause: str, quantity: JointQuantity
) -> Estimate:
    joint = None if body is None else body.joint
    fit = None if joint is None else fit_joint(trace, parameter.object, joint)
    if joint is None or fit is None:
        reason = f"No recording shows the handle of '{parameter.object}' move along its joint."
        return not_identified(parameter, quantity.unit, reason)
    # Unit of the joint, and the widest std that still adds to the prior.
    unit = joint.unit(quantity.per) if quantity.divided else ("N" if joint.is_slide else "N·m")
    value, std = fit.of(cause)
    lever = fit.lever
    most = quantity.believed[1] * (lever**2 if quantity.divided else lever)
    inertia, doubt = fit.of(INERTIA)
    return Estimate.normal(
        parameter,
        unit,
        value,
        std,
        _method(fit),
        fit.recordings,
        parts={"inertia": FurtherValue(inertia, doubt, "kg" if joint.is_slide else "kg m²")},
        tests=fit.tests,
        shared=fit.posterior.shared(cause),
        views=(_view(fit),),
        reason="" if std < most else AS_WIDE,
    )


def _method(fit: JointFit) -> str:
    slowest, fastest = fit.speeds
    unit = fit.joint.unit()
    empty = sum(recording.context.holding is None for recording in fit.recordings)
    contrast = "against the same motion of the empty hand" if empty else "without an empty pass"
    return (
        f"Force along the joint in passes to and fro at {slowest:.2g} to {fastest:.2g} {unit}/s, "
        f"{contrast}: what keeps its size is dry friction, what grows with the speed damping, what grows "
        "with the way a spring."
    )


def _view(fit: JointFit) -> FitView:
    """Chart of the force along the joint over its rate."""
    # Blocks with the handle in the hand, without causes in the arm.
    held = fit.passes.held > 0.0
    own = fit.own()[held]
    unit = fit.joint.unit()
    return FitView(
        name="Force along the joint.",
        note="Without what the arm itself feels. It jumps by twice the dry friction where the way turns round, "
        "and grows with the speed by the damping.",
        axes=(f"rate ({unit}/s)", "force (N)" if fit.joint.is_slide else "moment (N m)"),
        x=fit.passes.rate[held],
        measured=own,
        predicted=fit.predicted()[held],
        groups="passes",
    )
