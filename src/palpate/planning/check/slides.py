"""Slides that are to be felt: long enough and level, and what to write where one is not."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from palpate.errors import InputError
from palpate.scene.symbols import PoseExpression
from palpate.vocabulary.admissible.support import LIFTED, MIN_SLIDE, dragged_off, slides
from palpate.vocabulary.motion import MovePose
from palpate.vocabulary.state import SymbolicState
from palpate.vocabulary.violation import Violation

COMFORTABLE = (1.5, 1.1)
"""Times `MIN_SLIDE` that a slide is proposed to be long: well above what is asked, else just."""
SIDES = (("x_offset", 1), ("x_offset", -1), ("y_offset", 1), ("y_offset", -1))
"""Ways along which one is proposed: along the object first."""


def unfelt(before: SymbolicState, after: SymbolicState) -> Violation | None:
    """Violation of a motion beside a force log, of a held object on its support: too short a slide,
    downward, or off the support. A lift is no slide."""
    start, end = before.pose_world_tcp, after.pose_world_tcp
    if before.holding is None or before.lifted or start is None or end is None:
        return None
    down, travel = float(start.position[2] - end.position[2]), start.distance_to(end)
    if down > LIFTED:
        how = f"goes {1e3 * down:.0f} mm down, into the support"
    elif slides(before, after) and travel < MIN_SLIDE:
        how = f"is {math.floor(1e4 * travel) / 10:.1f} mm long"
    elif dragged_off(before, after):
        how = "leads off the support"
    else:
        return None
    return Violation(
        "short-slide",
        f"the slide of '{before.holding}' to '{after.at}' {how}; a slide is level and at least "
        f"{1e3 * MIN_SLIDE:.0f} mm long{instead(before)}",
    )


def instead(before: SymbolicState) -> str:
    """A slide that may be written there, in words; empty where none is found."""
    for pose in _level(before):
        slide = MovePose(pose=str(pose))
        if slide.violations(before):
            continue
        after = slide.effects(before)
        if slides(before, after):
            travel = _travel(before, after)
            return f"; write MovePose '{pose}' ({1e3 * travel:.0f} mm)"
    return ""


def _level(state: SymbolicState) -> Iterator[PoseExpression]:
    """Poses at the height of the present one, beside it."""
    symbols = state.scene.symbols
    try:
        here = symbols.parse(state.at or "")
    except InputError:
        return
    for length in COMFORTABLE:
        for offset, sign in SIDES:
            size = float(np.linalg.norm(symbols.offset(offset, here.name)))
            factor = math.ceil(10 * length * MIN_SLIDE / max(size, 1e-3)) / 10
            yield here.shifted(offset, sign * factor)


def _travel(before: SymbolicState, after: SymbolicState) -> float:
    assert before.pose_world_tcp is not None
    assert after.pose_world_tcp is not None
    return before.pose_world_tcp.distance_to(after.pose_world_tcp)
