"""What counts as evidence of a quantity."""

from __future__ import annotations

from palpate.parameter import Parameter
from palpate.trace.recording import Context
from palpate.trace.samples import FORCES

COM_GRASPS = 3
"""Distinct grasps that a centre of mass is derived from."""


DERIVED: dict[str, str] = {
    "friction": "a MeasureForces while the object is held still, lifted (the normal force is measured against "
    "it), and one in a Parallel with a MovePose that slides the held object along its support",
    "com": f"a MeasureForces while the object is held still, lifted, at each of {COM_GRASPS} different grasp poses",
}
"""Quantities without a conversion, by id, with the recordings they need."""


NEEDED = {"friction": 2, "com": COM_GRASPS}
"""Different pieces of evidence that a derived quantity takes."""


def piece(parameter: Parameter, buffer: str, context: Context) -> str | None:
    """Which piece of evidence for a derived quantity a recording is, None when it is none."""
    if buffer != FORCES or context.holding != parameter.object:
        return None
    if parameter.quantity == "friction":
        return context.activity if context.activity in ("still", "sliding") else None
    return context.grasp if parameter.quantity == "com" and context.activity == "still" else None


def supports(parameter: Parameter, buffer: str, context: Context) -> bool:
    """Whether a recording is evidence for a derived quantity."""
    return piece(parameter, buffer, context) is not None
