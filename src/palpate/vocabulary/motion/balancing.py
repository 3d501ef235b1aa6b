"""Balance point of an object, estimated while a plan runs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from palpate.estimation.estimate import Estimate
from palpate.geometry.pose import Array, Line
from palpate.parameter import Parameter
from palpate.quantities.com import CentreOfMass
from palpate.quantities.estimators import estimate_all
from palpate.vocabulary.base import Blackboard


@dataclass(frozen=True, slots=True)
class Place:
    """A place along a line, m, and what it rests on, in words."""

    along: float
    why: str


def bind(blackboard: Blackboard, name: str) -> None:
    """From now on a pose that is found out by running is where the object balances, by what has been
    measured so far. It is bound once: where the hand took something it also puts it down."""
    state, symbols = blackboard.state, blackboard.scene.symbols
    if name in state.bound:
        return
    place = _found(blackboard, symbols.subjects[name], symbols.lines[name])
    blackboard.state = replace(state, bound={**state.bound, name: place.along})
    blackboard.bound[name] = f"{name} is {1e3 * place.along:+.0f} mm along, {place.why}"


def _found(blackboard: Blackboard, subject: str, line: Line) -> Place:
    """The place on a line that is nearest to where an object balances."""
    trace, scene = blackboard.recorder.snapshot(), blackboard.scene
    (found,) = estimate_all([Parameter(subject, CentreOfMass.id)], trace, scene.bodies)
    if found.verdict != "identified":
        return Place(line.believed, f"as believed: {found.verdict} so far")
    body = scene.body(subject)
    std = _std(found, body.pose_world.rotation.T @ line.along)
    along = line.nearest(body.pose_at_rest.apply(found.values))
    apart = along - line.believed
    if abs(apart) < std:
        doubt = f"measured {1e3 * apart:+.0f} ± {1e3 * std:.0f} mm from there"
        return Place(line.believed, f"as believed: {doubt}")
    return Place(along, f"as measured to ± {1e3 * std:.1f} mm")


def _std(found: Estimate, along: Array) -> float:
    """m along a direction of the object (3,), at most."""
    return float(np.abs(along) @ found.stds)
