"""Rotational inertia of an object, which nothing in the vocabulary excites."""

from __future__ import annotations

from palpate.estimation.estimate import Estimate, not_identified
from palpate.mjcf.body import Body
from palpate.parameter import Parameter
from palpate.trace.samples import Trace

UNIT = "kg·m²"


def estimate_inertia(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Never identified: an inertia shows in the torque of an angular acceleration only."""
    return not_identified(
        parameter,
        UNIT,
        "The recordings hold no rotation of the object, so its inertia is not excited.",
    )
