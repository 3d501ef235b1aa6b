"""A quantity of one's own: rolling friction, the third number of MuJoCo's `friction`.

This one file is all there is to it, beside an entry point in the group `palpate.quantities`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Estimate, not_identified
from palpate.estimation.quantities.quantity import Evidence, Prior, Quantity, Status, Values
from palpate.mjcf.body import Body, BodyDescription
from palpate.mjcf.edits import Edit, Slot, number
from palpate.mjcf.elements import Elements
from palpate.trace.samples import FORCES, Trace

THIRD = 2
"""Position of the rolling coefficient in `friction`, after the sliding and the torsional one."""
USUAL = 1e-4
"""m: MuJoCo's default."""


class RollingFriction(Quantity):
    """Rolling friction of an object, measured only where the file writes `?`."""

    id = "rolling_friction"
    unit = "m"
    subject = "object"
    label = "rolling friction"
    words: ClassVar = {"en": ("rolling friction", "rolling resistance")}
    evidence = (
        Evidence(FORCES, "MeasureForces while held still", activity=("still",), holding=True),
        Evidence(
            FORCES,
            "in a Parallel with a MovePose that drags it along its support",
            activity=("sliding",),
            holding=True,
        ),
    )
    derived = True
    estimators: ClassVar = {"stub": "palpate_rolling:estimate_rolling_friction"}

    def status(self, body: BodyDescription) -> Status:
        open_numbers = [number for slot in self._stated(body) for number in slot]
        return "missing" if open_numbers else "known"

    def known(self, body: BodyDescription) -> tuple[float, ...]:
        ids = [body.shapes.geom_ids[geom] for geom in body.elements.colliding]
        return (max(float(body.shapes.model.geom_friction[i][THIRD]) for i in ids),)

    def slots(self, elements: Elements) -> Iterator[Slot]:
        for geom in elements.geoms:
            yield Slot(geom, "friction", number(USUAL), (THIRD,))

    def prior(self, body: BodyDescription, believed: Values) -> Prior:
        return Prior((USUAL,), (USUAL,))

    def write(
        self, body: BodyDescription, value: tuple[float, ...], std: float | None
    ) -> Iterator[Edit]:
        """With `condim="6"`, without which MuJoCo leaves rolling friction out."""
        for slot, unknown in zip(self.slots(body.elements), self._stated(body), strict=True):
            if unknown:
                yield Edit(slot.element, "friction", {THIRD: number(value[0], std)})
                yield Edit(slot.element, "condim", {0: "6"})

    def _stated(self, body: BodyDescription) -> list[list[int]]:
        return [
            slot.open_numbers(slot.element.get("friction")) for slot in self.slots(body.elements)
        ]


def estimate_rolling_friction(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """A stub: half a millimetre, if there is evidence at all."""
    quantity = RollingFriction()
    logged = [(recording.buffer, recording.context) for recording in trace.recordings]
    if not quantity.is_evidenced(parameter, logged):
        return not_identified(parameter, quantity.unit, "It was not dragged.")
    return Estimate.normal(parameter, quantity.unit, 5e-4, 1e-5, "A stub.", trace.recordings)
