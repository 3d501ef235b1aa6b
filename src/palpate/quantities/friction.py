"""Coulomb friction between a held object and what it is dragged along."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import ClassVar

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.drag import Drag, dynamic_friction, static_friction, steady_drags
from palpate.estimation.estimate import Estimate, Part, not_identified
from palpate.geometry.pose import Array
from palpate.mjcf.body import Body, BodyDescription
from palpate.mjcf.defaults import MUJOCO_FRICTION
from palpate.mjcf.document import UNKNOWN, Element, tokens
from palpate.mjcf.edits import Edit, Slot, number
from palpate.mjcf.roles import Elements
from palpate.parameter import Parameter
from palpate.quantities.evidence import Evidence
from palpate.quantities.quantity import Prior, Quantity, Status, Values
from palpate.trace.recording import Recording
from palpate.trace.samples import FORCES, Trace

UNIT = "1"

PRIOR_FRICTION = 0.5
"""Of household things on wood and plastics."""

PRIOR_SPREAD = 0.15
"""1 sigma."""

TRUE_FRICTION = (0.25, 0.7)
"""Range in which a hidden friction is drawn."""


class Friction(Quantity):
    """Sliding friction of an object: the first number of `friction`, the dynamic coefficient."""

    id = "friction"
    unit = UNIT
    subject = "object"
    label = "sliding friction"
    words: ClassVar = {"en": ("friction", "slipperiness", "slippery", "grip", "mu")}
    evidence = (
        Evidence(
            FORCES, "MeasureForces while held still in the air", activity=("still",), holding=True
        ),
        Evidence(
            FORCES,
            "in a Parallel with a MovePose that slides the held object along its support",
            activity=("sliding",),
            holding=True,
        ),
    )
    derived = True
    estimators: ClassVar = {"drag": "palpate.quantities.friction:estimate_friction"}

    def status(self, body: BodyDescription) -> Status:
        return "missing" if _lacking(body) else "known"

    def known(self, body: BodyDescription) -> tuple[float, ...]:
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
        """With `priority="1"`, without which MuJoCo would take the larger of the object's and its
        support's coefficient."""
        text = number(value[0], std)
        for geom in _lacking(body) or body.elements.colliding:
            base = body.defaults.attribute(geom, "friction") or " ".join(MUJOCO_FRICTION)
            numbers = {
                i: MUJOCO_FRICTION[i] for i, part in enumerate(tokens(base)[:3]) if part == UNKNOWN
            }
            yield Edit(geom, "friction", {**numbers, 0: text}, base)
            if not body.defaults.attribute(geom, "priority"):
                yield Edit(geom, "priority", {0: "1"})


def _lacking(body: BodyDescription) -> tuple[Element, ...]:
    """Geoms whose sliding friction is written `?`; when no geom states any, all that can touch."""
    geoms = body.elements.colliding
    stated = {geom: tokens(body.defaults.attribute(geom, "friction")) for geom in geoms}
    marked = tuple(geom for geom, parts in stated.items() if parts[:1] == [UNKNOWN])
    if marked or any(stated.values()):
        return marked
    return geoms


def estimate_friction(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Sliding friction of an object on its support from every drag in the trace, recorded or on
    the way back.

    The value is the dynamic coefficient; `parts` holds `static` and `dynamic`, and the `normal
    force`.
    """
    evidence = _sliding(trace, parameter.object)
    drags = steady_drags(trace, parameter.object)
    if not drags:
        return not_identified(
            parameter,
            UNIT,
            "No recording shows the held object sliding steadily along its support.",
            evidence,
        )
    dynamic = dynamic_friction(drags)
    # Both forces carry the gain of the joints that sensed them.
    gain = tuning.GAIN_RATIO * trace.hand.torque_gain * dynamic.value
    std = float(np.hypot(dynamic.std, gain))
    normal = _normal_forces(drags)
    method = _method(len(drags), float(normal.min()), float(normal.max()))
    if dynamic.value <= tuning.SIGNIFICANT * std:
        found = f" The result, {dynamic.value:.2g} ± {std:.2g}, cannot be told from none."
        return not_identified(parameter, UNIT, method + found, evidence)

    parts = {
        "dynamic": Part(dynamic.value, std),
        "normal force": Part(float(normal.mean()), float(normal.std()), "N"),
    }
    static = static_friction(drags, dynamic)
    if static is not None:
        parts["static"] = Part(*static)
    return Estimate.normal(
        parameter, UNIT, dynamic.value, std, method, evidence, parts=parts, least=0.0
    )


def _sliding(trace: Trace, name: str) -> tuple[Recording, ...]:
    """Recordings made while the held object was dragged."""
    found: list[Recording] = []
    for recording in trace.recordings:
        context = recording.context
        if context.activity == "sliding" and context.holding == name:
            found.append(recording)
    return tuple(found)


def _normal_forces(drags: Sequence[Drag]) -> Array:
    """(n,) N, in all rows of steady sliding."""
    return np.concatenate([drag.normal[drag.steady] for drag in drags])


def _method(drags: int, least: float, most: float) -> str:
    return (
        f"Tangential over normal force in {drags} drag{'s' * (drags > 1)} under "
        f"{least:.1f} to {most:.1f} N, both measured against the object hanging free; "
        "static at breakaway, dynamic while sliding steadily."
    )
