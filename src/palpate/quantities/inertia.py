"""Rotational inertia of an object, which nothing in the vocabulary excites."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from palpate.estimation.estimate import Estimate, not_identified
from palpate.geometry.inertia import inertia_components
from palpate.mjcf.body import Body, BodyDescription
from palpate.mjcf.edits import Slot
from palpate.mjcf.inertial import Statement, com_of, inertia_for, inertia_is_open, mass_of
from palpate.mjcf.roles import Elements
from palpate.parameter import Parameter
from palpate.quantities.quantity import Prior, Quantity, Status, Values
from palpate.trace.samples import Trace

UNIT = "kg·m²"

SPREAD = 0.5
"""Part of the prior that is its 1 sigma: mass may sit at the rim or in the core."""


class Inertia(Quantity):
    """Inertia about the centre of mass in body axes: xx yy zz xy xz yz."""

    id = "inertia"
    unit = UNIT
    subject = "object"
    label = "inertia tensor"
    words: ClassVar = {
        "en": ("inertia", "moment of inertia", "moments of inertia", "inertia tensor")
    }
    size = 6
    how = "needs dynamic excitation, which no primitive offers"
    identifiable = False
    estimators: ClassVar = {"none": "palpate.quantities.inertia:estimate_inertia"}

    def status(self, body: BodyDescription) -> Status:
        if body.elements.inertial is None:
            return "assumed"
        return "missing" if inertia_is_open(body.elements.inertial) else "known"

    def known(self, body: BodyDescription) -> tuple[float, ...]:
        compiled = body.shapes.model.body(body.name)
        return inertia_components(compiled.inertia, compiled.iquat)

    def slots(self, elements: Elements) -> Iterator[Slot]:
        if elements.inertial is not None:
            yield Slot(elements.inertial, "diaginertia", "0.001")
            whole = ("1", "1", "1", "0", "0", "0")
            yield Slot(elements.inertial, "fullinertia", "1", whole=whole)

    def prior(self, body: BodyDescription, believed: Values) -> Prior:
        """Of the object's shape, with the mass and the centre of mass that are believed."""
        mass = believed.get(Parameter(body.name, "mass"), (mass_of(body),))
        com = believed.get(Parameter(body.name, "com")) or com_of(body)
        mean = inertia_for(body, mass[0], com)
        return Prior(mean, tuple(SPREAD * abs(part) for part in mean))

    def write(
        self, body: BodyDescription, value: tuple[float, ...], std: float | None
    ) -> Iterator[Statement]:
        yield Statement(inertia=value, std=std)


def estimate_inertia(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Never identified: an inertia shows in the torque of an angular acceleration only."""
    return not_identified(
        parameter,
        UNIT,
        "The recordings hold no rotation of the object, so its inertia is not excited.",
    )
