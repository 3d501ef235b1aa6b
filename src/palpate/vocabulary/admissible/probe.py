"""Contact of a guarded motion, and its admissibility."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from palpate.geometry.polygon import depth
from palpate.geometry.pose import Array, Pose, digits
from palpate.vocabulary.admissible.collision_geometry import hand_sweep, opening
from palpate.vocabulary.admissible.solids import SIDES, solids
from palpate.vocabulary.admissible.support import TIPPING, footing
from palpate.vocabulary.admissible.sweep import FINEST, Hit, hand_path
from palpate.vocabulary.state import SymbolicState
from palpate.vocabulary.violation import PRECONDITION, Violation

TOUCHES = 0.0003
"""m of distance up to which parts are in contact."""
LEVEL = 0.5
"""z component of a direction below which a probe is sideways."""


@dataclass(frozen=True, slots=True)
class Touch:
    """First contact of a guarded motion, and the pose of the TCP (world) just before it."""

    hit: Hit
    pose: Pose


def starts(state: SymbolicState) -> str:
    """Remedy: a start of the probe above the surface below, if there is one."""
    below = None if state.pose_world_tcp is None else state.surface_below(state.pose_world_tcp)
    names = [below.name] if below is not None and below.role == "surface" else state.scene.surfaces
    places = [f"'{name}_approach'" for name in names]
    if not places:
        return "go lower"
    return f"a surface is probed with -z from near above: MovePose to {' or '.join(places)} first"


def touch(state: SymbolicState, direction: Array, travel: float) -> Touch | None:
    """First believed contact of the hand within `travel` m along a direction (3,); None without
    contact, or from an unknown pose."""
    if state.pose_world_tcp is None:
        return None
    start, key = state.pose_world_tcp, ("touch", *state.arrangement, digits(direction), travel)
    return solids(state.scene).cached(key, lambda: _touch(state, start, direction, travel))


def _touch(state: SymbolicState, start: Pose, direction: Array, travel: float) -> Touch | None:
    end = start.translated(travel * direction)
    swept = hand_sweep(state, hand_path(start, end, opening(state), FINEST))
    first = swept.first(np.full(len(swept.pairs), TOUCHES))
    if first is None:
        return None
    clear = max(first.share * travel - FINEST, 0.0)
    return Touch(first, start.translated(clear * direction))


def untouchable(state: SymbolicState, direction: Array, travel: float) -> Iterator[Violation]:
    """Violation of a guarded motion: no contact, or an inadmissible one."""
    first = touch(state, direction, travel)
    if first is None:
        yield Violation(
            PRECONDITION,
            f"there is nothing to touch within {travel:.2f} m from '{state.at}'; {starts(state)}",
        )
        return
    name = first.hit.other.owner
    if first.hit.part.kind not in SIDES:
        yield Violation(
            "collision",
            f"'{name}' would be met by the {first.hit.part.owner} and not by the fingertips; probe "
            "from a pose above the middle of what is to be touched, clear of everything else",
        )
    elif name in state.scene.objects and abs(direction[2]) > LEVEL:
        there = footing(state, name, state.pose_of(name))
        if depth(there.support, np.array(first.hit.where[:2])) < TIPPING:
            yield Violation(
                "unsupported",
                f"pressing on '{name}' there would tip it over; touch it above the middle of what "
                f"it stands on; first: MovePose '{name}_top', FoldFingers",
            )
