"""Centre of mass of a held object, from the moment of its weight about the hand at several grasps."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import ClassVar

import numpy as np

from palpate.common.parameter import Parameter
from palpate.estimation.balance import COM_PRIOR, accuracy, balance, balance_views, grasps_of
from palpate.estimation.estimate import Estimate, FurtherValue, half95, not_identified
from palpate.estimation.holds import ObjectHolds, find_holds
from palpate.estimation.quantities.quantity import (
    Evidence,
    Logged,
    Prior,
    Quantity,
    Status,
    Values,
    held_and_empty,
)
from palpate.mjcf.body import Body, BodyDescription
from palpate.mjcf.contacts import find_constraint
from palpate.mjcf.document import UNKNOWN, tokens
from palpate.mjcf.edits import Slot
from palpate.mjcf.elements import Elements
from palpate.mjcf.inertial import Statement, com_of, is_incomplete
from palpate.trace.samples import FORCES, Trace

COM_ITERATIONS = 1
"""Number of solutions before the last. Sensitive: no."""
BLIND = 0.5
"""Ratio of posterior to prior 1 sigma above which a coordinate counts as not measured. Sensitive: no."""

UNIT = "m"
TRUE_SHIFT = 0.1
"""Largest offset of a hidden centre of mass from the prior, as a fraction of the object's extent per axis."""
WHOLE = (
    " Moments are from all motion in free air around that: noise alone accounts for the residuals of a model of "
    "the arm's links, sensors and friction there."
)


class CentreOfMass(Quantity):
    """Centre of mass in the body frame, as stated in `<inertial>`."""

    id = "com"
    unit = UNIT
    subject = "object"
    label = "centre of mass"
    words: ClassVar = {
        "en": (
            *("centre of mass", "center of mass", "centre of gravity", "center of gravity"),
            *("com", "cog", "balance point"),
        ),
        "de": ("schwerpunkt", "massenmittelpunkt", "massenschwerpunkt"),
        "es": ("centro de masa", "centro de masas", "centro de gravedad"),
        "fr": ("centre de masse", "centre de gravité"),
        "it": ("centro di massa", "baricentro", "centro di gravità"),
    }
    size = 3
    evidence = (
        Evidence(
            FORCES,
            "MeasureForces while held still at three grasp offsets along its long axis",
            activity=("still",),
            holding=True,
            distinct="grasp",
            count=3,
        ),
        *held_and_empty(FORCES, "Turn", "turning", "in free air", optional=True),
    )
    how = evidence[0].how
    derived = True
    estimators: ClassVar = {
        "torque": "palpate.estimation.quantities.com:estimate_com",
        "recording": "palpate.estimation.carried:estimate_com",
    }

    def status(self, body: BodyDescription) -> Status:
        if body.elements.inertial is None:
            return "assumed"
        return "missing" if is_incomplete(body.elements.inertial, "pos") else "known"

    def compiled(self, body: BodyDescription) -> tuple[float, ...]:
        return com_of(body)

    def overruled(self, body: BodyDescription) -> str:
        return find_constraint(body)

    def slots(self, elements: Elements) -> Iterator[Slot]:
        if elements.inertial is not None:
            yield Slot(elements.inertial, "pos", "0", required=3)

    def prior(self, body: BodyDescription, believed: Values) -> Prior:
        """Prior at the middle of the geoms, except for stated numbers."""
        stated = [UNKNOWN] * 3
        if body.elements.inertial is not None:
            stated = tokens(body.elements.inertial.get("pos")) or stated
        # Box of the geoms with a prior proportional to its extent; stated numbers are exact.
        mean, extents = (part.tolist() for part in body.box())
        std = [COM_PRIOR * max(extent, 1e-3) for extent in extents]
        for i, part in enumerate(stated):
            if part != UNKNOWN:
                mean[i], std[i] = float(part), 0.0
        return Prior(tuple(mean), tuple(std))

    def draw(self, body: Body, prior: Prior, random: np.random.Generator) -> tuple[float, ...]:
        """Draw uniformly around the prior, up to `TRUE_SHIFT` of the object's extents."""
        scale = TRUE_SHIFT * body.size
        shift = random.uniform(-scale, scale) * (np.array(prior.std) > 0)
        return tuple(float(v) for v in np.array(prior.mean) + shift)

    def write(
        self, body: BodyDescription, value: tuple[float, ...], std: float | None
    ) -> Iterator[Statement]:
        """Write into `<inertial>`, created if absent, with the inertia of the geoms about the new centre."""
        yield Statement(com=value, std=std)


IN_SPACE = (
    *("height of its {}", "height of the {}"),
    *("{} in 3d", "{} in three dimensions", "{} in all three axes", "{} along all three axes"),
    *("3d {}", "three dimensional {}", "full {}"),
)
"""Names of a centre of mass with its height."""


class CentreOfMassInSpace(CentreOfMass):
    """Centre of mass including the component along gravity, from tilted holds; written in place of `com`."""

    id = "com_3d"
    label = "centre of mass in all three axes"
    words: ClassVar = {"en": tuple(f.format(c) for c in CentreOfMass.words["en"] for f in IN_SPACE)}
    evidence = (CentreOfMass.evidence[0], *held_and_empty(FORCES, "Tilt", "tilting", "in free air"))
    how = "as com, and in a Parallel with Tilt, held in free air and empty"
    stands_for = "com"
    entire = True

    def status(self, body: BodyDescription) -> Status:
        """Not applicable: `com` represents the centre of mass in the file."""
        return "not applicable"

    def slots(self, elements: Elements) -> Iterator[Slot]:
        yield from ()  # that of `com` is the same

    def is_told_in_part(self, parameter: Parameter, logged: Iterable[Logged]) -> bool:
        """True with the evidence of `com`: without tilts, only the component along gravity is missing."""
        return CentreOfMass().is_evidenced(parameter, logged)


def estimate_com(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Centre of mass in the body frame from all recordings of the object held at rest in the air.

    A level grasp determines the horizontal coordinates. The one along gravity keeps the geometric centre with its
    prior standard deviation, and the method says so. `parts` holds the `mass` from all grasps, and the
    `least torque`.
    """
    found = None if body is None else find_holds(trace, body)
    if body is None or found is None:
        return not_identified(
            parameter, UNIT, "No recording shows the object held still in the air."
        )
    load = found.load
    # Equations of the grasps, repeated with the droop at the estimated centre.
    grasps = grasps_of(trace, found, body, body.centre)
    for _ in range(COM_ITERATIONS):
        # The effect of a rotation in the grip depends on the centre of mass.
        centre, *_ = balance(grasps, body)
        grasps = grasps_of(trace, found, body, centre)
    centre, covariance, agree, shared = balance(grasps, body)
    # Further results: mass of the joint fit, and the smallest moment.
    torques = [float(np.hypot(*moment)) for moment in load.value[1:].reshape(-1, 2)]
    parts = {
        "mass": FurtherValue(load.force / trace.gravity, load.force_std / trace.gravity, "kg"),
        "least torque": FurtherValue(min(torques), 0.0, "N·m"),
    }
    # Coordinates that the recordings hardly narrow keep the geometric centre.
    std = np.sqrt(np.diag(covariance))
    blind = std > BLIND * COM_PRIOR * body.size
    value, half = np.where(blind, body.centre, centre), std * half95(grasps.freedom)
    return Estimate(
        parameter,
        UNIT,
        values=value,
        stds=std,
        intervals=np.column_stack([value - half, value + half]),
        method=com_method(found, blind.tolist(), body),
        evidence=tuple(grasps.recordings),
        verdict="prior-dominated" if bool(blind.all()) else "identified",
        parts=parts,
        tests=(*load.tests, agree),
        shared=shared,
        freedom=grasps.freedom,
        unseen=tuple(np.flatnonzero(blind).tolist()),
        views=tuple(balance_views(grasps, found, centre)),
    )


def com_method(found: ObjectHolds, blind: Sequence[bool], body: Body) -> str:
    """Describe the holds, the assumptions, and the components without evidence."""
    grasps = len({hold.grasp for hold in found.holds})
    where = f"at {grasps} grasp{'s' * (grasps > 1)}"
    if found.turned:
        where += ", and along a turn about the vertical"
    if tilts := len(found.holds) - grasps:
        where += f", and in {tilts} bits of tilts"
    said = "as stated" if body.accuracy else "assumed, as poses.yaml states no accuracy"
    method = (
        f"Horizontal moment over weight of the object held still {where}, each against the empty hand, and the "
        "object's position in the scene, whose error along the fingers, "
        f"{1e3 * accuracy(body, found.holds[0].along):.2g} mm (1 sigma, {said}), no grasp shows"
    )
    axes = " and ".join(axis for axis, unseen in zip("xyz", blind, strict=True) if unseen)
    if axes:
        method += f"; {axes} lies along gravity in every grasp and keeps the geometric centre (prior-dominated)"
    return method + "." + WHOLE * found.by_all_motion
