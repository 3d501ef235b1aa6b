"""When is a gap discharged? By its conversion, or, for a derived quantity, by the recordings it is derived from."""

from __future__ import annotations

from palpate.quantities import Gap
from palpate.trace import FORCES, Context
from palpate.vocabulary.primitive import Primitive, vocabulary
from palpate.vocabulary.state import SymbolicState

COM_GRASPS = 3
"""Distinct grasps that a centre of mass is derived from."""

DERIVED: dict[str, str] = {
    "friction": "a MeasureForces while the object is held still, lifted (the normal force is measured against "
                "it), and one in a Parallel with a MovePose that slides the held object along its support",
    "com": f"a MeasureForces while the object is held still, lifted, at each of {COM_GRASPS} different grasp poses",
}
"""Quantities without a conversion, by id, with the recordings they need."""


def converters(quantity: str) -> list[type[Primitive]]:
    """Primitives that convert a buffer into `quantity`."""
    return [cls for cls in vocabulary().primitives.values() if cls.measures is not None and cls.measures.id == quantity]


def sensors(buffer: str | None) -> list[type[Primitive]]:
    """Primitives that write `buffer`."""
    return [cls for cls in vocabulary().primitives.values() if buffer is not None and cls.writes == buffer]


NEEDED = {"friction": 2, "com": COM_GRASPS}
"""Different pieces of evidence that a derived quantity takes."""


def piece(gap: Gap, buffer: str, context: Context) -> str | None:
    """Which piece of evidence for a derived quantity a recording is, None when it is none."""
    if buffer != FORCES or context.holding != gap.object:
        return None
    if gap.quantity == "friction":
        return context.activity if context.activity in ("still", "sliding") else None
    return context.grasp if gap.quantity == "com" and context.activity == "still" else None


def supports(gap: Gap, buffer: str, context: Context) -> bool:
    """Whether a recording is evidence for a derived quantity."""
    return piece(gap, buffer, context) is not None


def amount(gap: Gap, state: SymbolicState) -> int:
    """How much of the evidence for `gap` there is."""
    if gap in state.converted:
        return max(NEEDED.values())
    return len({piece(gap, buffer, context) for buffer, context in state.logged} - {None})


def discharged(gap: Gap, state: SymbolicState) -> bool:
    """Whether what was recorded and converted so far yields `gap`."""
    if gap.quantity not in DERIVED:
        return gap in state.converted
    return amount(gap, state) >= NEEDED[gap.quantity]
