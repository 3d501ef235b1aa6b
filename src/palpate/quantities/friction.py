"""Coulomb friction between a held object and what it is dragged along."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.drag import Drag, dynamic_friction, static_friction, steady_drags
from palpate.estimation.estimate import Estimate, Part, not_identified
from palpate.geometry.pose import Array
from palpate.mjcf.body import Body
from palpate.parameter import Parameter
from palpate.trace.recording import Recording
from palpate.trace.samples import Trace

UNIT = "1"


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
