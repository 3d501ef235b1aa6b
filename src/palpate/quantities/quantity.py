"""The catalogue of physical quantities: one declaration each, from which everything else derives.

A `Parameter` is the thread through the program: a plan promises it, a recording evidences it, an
estimate discharges it and the twin shows it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from palpate.errors import unknown_name


@dataclass(frozen=True, slots=True)
class Quantity:
    """A physical quantity that palpate knows by name.

    Attributes:
        id: name in plans, results and on the command line.
        unit: SI unit, as printed.
        label: words for people.
        synonyms: other words a request may use, singular, lower case.
        size: number of components of its value.
        subject: what carries it, `object`, `surface` or `gripper`.
        identifiable: whether the vocabulary can measure it at all.
        how: one sentence for prompts and explanations: how it is acquired.
        estimators: by name, the default first; each `package.module:function`, which is imported
            when it is used, and keeps to the contract of `palpate.estimation.estimator.Estimator`.
    """

    id: str
    unit: str
    label: str
    synonyms: tuple[str, ...]
    size: int
    subject: str
    how: str
    identifiable: bool = True
    estimators: Mapping[str, str] = field(default_factory=dict[str, str], hash=False)


_CATALOGUE = (
    Quantity(
        "mass",
        "kg",
        "mass",
        ("mass", "weight", "heavy", "weigh", "heaviness"),
        1,
        "object",
        "lift the object clear of its support, MeasureForces while still, then Force2Mass",
        estimators={
            "contrast": "palpate.quantities.mass:estimate_mass",
            "single-shot": "palpate.quantities.mass:estimate_single_shot",
        },
    ),
    Quantity(
        "height",
        "m",
        "height",
        ("height", "elevation", "level", "high", "tall"),
        1,
        "surface",
        "MoveUntilContact -z over a free spot, MeasureGripperPose, then Pose2Height",
        estimators={"loading-curve": "palpate.quantities.height:estimate_height"},
    ),
    Quantity(
        "friction",
        "1",
        "sliding friction",
        ("friction", "slipperiness", "slippery", "grip", "mu"),
        1,
        "object",
        "MeasureForces while held still in the air, and in a Parallel with a MovePose that slides the "
        "held object along its support; derived",
        estimators={"drag": "palpate.quantities.friction:estimate_friction"},
    ),
    Quantity(
        "com",
        "m",
        "centre of mass",
        (
            "centre of mass",
            "center of mass",
            "centre of gravity",
            "center of gravity",
            "com",
            "cog",
            "balance point",
        ),
        3,
        "object",
        "MeasureForces while held still at three grasp offsets along its long axis; derived",
        estimators={"torque": "palpate.quantities.com:estimate_com"},
    ),
    Quantity(
        "inertia",
        "kg·m²",
        "inertia tensor",
        ("inertia", "moment of inertia", "moments of inertia", "inertia tensor"),
        6,
        "object",
        "needs dynamic excitation, which no primitive offers",
        identifiable=False,
        estimators={"none": "palpate.quantities.inertia:estimate_inertia"},
    ),
    Quantity(
        "position",
        "m",
        "position",
        ("position", "location", "place", "whereabouts", "where"),
        2,
        "object",
        "MeasureGripperPose while holding the object, then Pose2Plan",
        estimators={"fingers": "palpate.quantities.position:estimate_position"},
    ),
    Quantity(
        "velocity",
        "m/s",
        "velocity",
        ("velocity", "speed"),
        3,
        "gripper",
        "MeasureForces in a Parallel with a motion, then Force2Velocity",
        estimators={"displacement": "palpate.quantities.velocity:estimate_velocity"},
    ),
    Quantity(
        "momentum",
        "kg·m/s",
        "momentum",
        ("momentum",),
        3,
        "gripper",
        "MeasureForces in a Parallel with a motion while holding an object, then Force2Momentum",
        estimators={"product": "palpate.quantities.momentum:estimate_momentum"},
    ),
)

QUANTITIES: dict[str, Quantity] = {q.id: q for q in _CATALOGUE}


def quantity(id: str) -> Quantity:
    """The catalogue entry named `id`.

    Raises:
        InputError: no such quantity; the message lists those there are.
    """
    if id not in QUANTITIES:
        raise unknown_name("quantity", id, QUANTITIES)
    return QUANTITIES[id]
