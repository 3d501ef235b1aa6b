"""Contact forces from a `Witness`, and their limits.

Source of the limits: 65 N is the quasi-static limit for the face in ISO/TS 15066, its lowest one. The
other limits are this project's own.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from palpate.common.pose import Array
from palpate.execution.witness import Pair, Witness
from palpate.trace.samples import STANDARD_GRAVITY

LIGHT = 1.5
"""kg, largest mass of a light object; heavier ones count as fixed."""


@dataclass(frozen=True)
class Figures:
    """Limits of a contact, N.

    Attributes:
        mean10, mean20: limits of running means over 10 and 20 ms.
        sideways: limit of horizontal 10 ms means on light free objects.
    """

    mean10: float = 65.0
    mean20: float = 45.0
    sideways: float = 25.0


SHOWN = Figures()
"""Limits for bodies of the scene."""


@dataclass(frozen=True, slots=True, eq=False)
class ContactRecord:
    """Contact of a body with the robot or the held object; forces in N, times in s.

    Attributes:
        thing: name of the touched body.
        part: body of the robot, or held object, with the largest force.
        load: `part` is the held object.
        light: the touched body is a free object of at most `LIGHT`.
        magnitude: (n,) sum of the magnitudes of all contacts in each physics step.
        mean10, mean20: largest running means of the magnitude over 10 and 20 ms.
        hardest: s, time of the largest 10 ms mean.
        sideways: largest horizontal 10 ms mean without a support from the other side.
        vertical: the largest force was more vertical than horizontal.
    """

    thing: str
    part: str
    load: bool
    light: bool
    magnitude: Array
    mean10: float
    mean20: float
    hardest: float
    sideways: float
    vertical: bool

    def beyond(self, figures: Figures) -> Iterator[str]:
        """Exceeded limits, as text."""
        who = f"{self.part} on {self.thing}"
        if self.mean10 > figures.mean10:
            yield f"{who}: {self.mean10:.0f} N over 10 ms"
        if self.mean20 > figures.mean20:
            yield f"{who}: {self.mean20:.0f} N over 20 ms"
        if self.light and self.sideways > figures.sideways:
            yield f"{who}: {self.sideways:.0f} N sideways over 10 ms"


def touches(witness: Witness) -> tuple[ContactRecord, ...]:
    """All contacts, the largest forces first."""
    # Group the pairs by the touched body.
    pairs: dict[str, list[Pair]] = {}
    for pair in witness.forces:
        pairs.setdefault(pair.thing, []).append(pair)
    found = [_touch(witness, thing, of_thing) for thing, of_thing in pairs.items()]
    return tuple(sorted(found, key=lambda touch: -touch.mean10))


def _touch(witness: Witness, thing: str, pairs: list[Pair]) -> ContactRecord:
    """Combine all pairs with one body into one contact; magnitudes of different parts add up."""
    magnitude, sideways = np.zeros(witness.steps + 1), np.zeros(witness.steps + 1)
    strongest_pair, strongest, upright = pairs[0], -1.0, True
    for pair in pairs:
        steps, vectors = witness.forces[pair].rows()
        # The weight of a held object on its support is no contact force of the robot.
        if pair.load:
            mass = witness.masses[witness.objects.index(pair.part)]
            vectors = _without_weight(vectors, STANDARD_GRAVITY * mass)
        size, horizontal = np.linalg.norm(vectors, axis=1), np.hypot(vectors[:, 0], vectors[:, 1])
        magnitude[steps] += size
        # Sideways pushes count only while no other body supports the touched one.
        free = ~np.isin(steps, list(witness.forces[pair].blocked))
        sideways[steps[free]] += horizontal[free]
        # Pair and direction of the largest force.
        if size.max() > strongest:
            worst = int(size.argmax())
            strongest_pair, strongest = pair, float(size[worst])
            upright = bool(abs(vectors[worst, 2]) > horizontal[worst])
    # Figures over all contacts of the body.
    dt = witness.period
    mean10 = running_mean(magnitude, 0.010, dt)
    masses = dict(zip(witness.objects, witness.masses, strict=True))
    return ContactRecord(
        thing,
        strongest_pair.part,
        strongest_pair.load,
        light=masses.get(thing, np.inf) <= LIGHT,
        magnitude=magnitude,
        mean10=float(mean10.max()),
        mean20=float(running_mean(magnitude, 0.020, dt).max()),
        hardest=float(mean10.argmax()) * dt,
        sideways=float(running_mean(sideways, 0.010, dt).max()),
        vertical=upright,
    )


def _without_weight(vectors: Array, weight: float) -> Array:
    """Forces (n, 3), N, of a load on its support, without the load's weight.

    Only downward forces are reduced, to zero at most.
    """
    pressed = vectors.copy()
    pressed[:, 2] = np.minimum(pressed[:, 2] + weight, np.maximum(pressed[:, 2], 0.0))
    return pressed


def running_mean(values: Array, window: float, dt: float) -> Array:
    """Compute running means over `window` s, indexed by the start of the window."""
    # By differences of cumulative sums, padded with zeros at the end.
    width = round(window / dt)
    sums = np.concatenate([[0.0], np.cumsum(np.concatenate([values, np.zeros(width)]))])
    return (sums[width:] - sums[:-width]) / width
