"""Purposes of a simulation, and the quantities that each needs of its object: one table for the prompt of
a model, the reading of requests and the documentation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

SHOWN = 3
"""Verbs of a purpose that a prompt names."""


@dataclass(frozen=True, slots=True)
class Purpose:
    """Purpose of a simulation.

    Attributes:
        verbs: English verbs that name it, the most common first.
        quantities: ids of the quantities of the object that decide its outcome.
        reason: physical reason, for the documentation.
    """

    verbs: tuple[str, ...]
    quantities: tuple[str, ...]
    reason: str

    def __str__(self) -> str:
        return f"to {'/'.join(self.verbs[:SHOWN])}: {', '.join(self.quantities)}"


def _purpose(verbs: str, quantities: str, reason: str) -> Purpose:
    return Purpose(tuple(verbs.split()), tuple(quantities.split()), reason)


PURPOSES = (
    _purpose(
        "lift carry grasp grip place raise pick transport hold fetch hoist move put bring hand pass",
        "mass",
        "the weight on the hand",
    ),
    _purpose("slide push drag pull shove", "mass friction", "the resistance of the support"),
    _purpose("roll", "mass friction inertia", "the resistance of the support, and to turning"),
    _purpose("stack pile", "mass friction com", "the load, and where it stands over its support"),
    _purpose(
        "topple tip tilt lean balance stand knock",
        "mass com_3d",
        "the edge over which the weight turns, and how high it is",
    ),
    _purpose("pour", "mass friction com_3d", "the torque on a grip that turns about a level axis"),
    _purpose(
        "throw drop swing toss juggle spin rotate turn flip catch twirl",
        "mass com inertia",
        "the motion of a free body about its centre of mass",
    ),
    _purpose("press squeeze indent", "stiffness", "the yielding under a force"),
)
"""All purposes; a verb stands in one of them."""


def quantities_by_verb() -> Mapping[str, tuple[str, ...]]:
    """Quantities of each purpose, by every verb of it."""
    return {verb: purpose.quantities for purpose in PURPOSES for verb in purpose.verbs}
