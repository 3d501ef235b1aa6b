"""Remedies in a finding: another motion to write, where one is found that breaks no rule."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from palpate.common.errors import InputError
from palpate.primitives.base import Primitive
from palpate.primitives.motion import MoveJoints, MovePose
from palpate.primitives.rules.support import (
    LIFTED,
    MIN_SLIDE,
    dragged_off,
    slides,
    surfaces_slid_on,
)
from palpate.primitives.state import HOME_CONFIG, SymbolicState, Violation
from palpate.scene.symbols import PoseExpression

COLLIDING = ("blocked", "collision", "self-collision")
"""Rules that another path may satisfy."""
HIGHER = (0.25, 0.5, 1.0, 1.5, 2.0, 3.0)
"""Multiples of z_offset by which a pose is tried higher."""
COMFORTABLE = (1.5, 1.1)
"""Lengths of a proposed slide in `MIN_SLIDE`: well above the minimum, else just above it."""
SIDES = (("x_offset", 1), ("x_offset", -1), ("y_offset", 1), ("y_offset", -1))
"""Directions of a proposed slide: along the object first."""


def offer_remedies(
    primitive: Primitive, before: SymbolicState, found: Sequence[Violation]
) -> list[Violation]:
    """Replace the advice of collisions by a path that avoids them, where one is found. The first of
    them names the path, the others state only what is hit."""
    # A collision whose message orders something "first", such as opening the fingers, has its remedy.
    colliding = [
        each
        for each in found
        if each.rule in COLLIDING and not (each.rule == "collision" and " first" in each.message)
    ]
    path = alternative(primitive, before) if colliding else ""
    if not path:
        return list(found)
    changed: list[Violation] = []
    for each in found:
        problem = each.message.partition("; ")[0]
        if each is colliding[0]:
            each = replace(each, message=f"{problem}; {path}")
        elif each in colliding:
            each = replace(each, message=problem)
        changed.append(each)
    return changed


def alternative(primitive: Primitive, before: SymbolicState) -> str:
    """Another path to the same pose, or a pose above it, in words; empty where none is found."""
    if isinstance(primitive, MoveJoints):
        home = MoveJoints(joints=HOME_CONFIG)
        return "" if home.violations(before) else f"write MoveJoints '{HOME_CONFIG}'"
    if not isinstance(primitive, MovePose):
        return ""
    above = raise_expression(primitive.pose, before)
    # Up from the start and across above the goal, as low as possible; else only across.
    starts = raise_expression(before.at or "", before)
    for number, across in enumerate(above):
        via = [*starts[number : number + 1], across]
        if is_free([*(MovePose(pose=pose) for pose in via), primitive], before):
            return "go over it, first: " + ", ".join(f"MovePose '{pose}'" for pose in via)
    # Where an object is to be grasped or put down, a higher pose is no substitute.
    if before.holding:
        at_object = before.scene.symbols.subject(primitive.pose) in (before.holding, None)
    else:
        at_object = before.object_at(primitive.target(before)) is not None
    for pose in () if at_object else above:
        if not MovePose(pose=pose).violations(before):
            return f"write MovePose '{pose}'"
    return ""


def is_free(motions: Sequence[MovePose], state: SymbolicState) -> bool:
    """True if all the motions, one after the other, break no rule."""
    for motion in motions:
        if motion.violations(state):
            return False
        state = motion.effects(state)
    return True


def raise_expression(expression: str, state: SymbolicState) -> list[str]:
    """The same pose higher up, lowest first; none for an unknown pose expression."""
    try:
        here = state.scene.symbols.parse(expression)
    except InputError:
        return []
    return [str(here.shift("z_offset", factor)) for factor in HIGHER]


def unfelt_slide(before: SymbolicState, after: SymbolicState) -> Violation | None:
    """Violation of a motion that drags a held object during a force log: too short, downward, off the
    support, or across several surfaces. A lift is no slide."""
    start, end = before.pose_world_tcp, after.pose_world_tcp
    if before.holding is None or before.lifted or start is None or end is None:
        return None
    down, travel = float(start.position[2] - end.position[2]), start.distance_to(end)
    if down > LIFTED:
        problem = f"goes {1e3 * down:.0f} mm down, into the support"
    elif slides(before, after) and travel < MIN_SLIDE:
        # Rounded down: a slide just below the minimum must not read as the minimum.
        problem = f"is {math.floor(1e4 * travel) / 10:.1f} mm long"
    elif dragged_off(before, after):
        problem = "leads off the support"
    elif slides(before, after) and len(surfaces_slid_on(before, after)) > 1:
        names = " and ".join(f"'{name}'" for name in dict.fromkeys(surfaces_slid_on(before, after)))
        problem = f"lies across parts of {names} that need not have the same friction"
    else:
        return None
    return Violation(
        "short-slide",
        f"the slide of '{before.holding}' to '{after.at}' {problem}; a slide is level, on one surface and at "
        f"least {1e3 * MIN_SLIDE:.0f} mm long{alternative_slide(before)}",
    )


def alternative_slide(before: SymbolicState) -> str:
    """A level slide that breaks no rule, in words; empty where none is found."""
    for pose in level_poses(before):
        slide = MovePose(pose=str(pose))
        if slide.violations(before):
            continue
        after = before.after(slide)
        if slides(before, after) and len(surfaces_slid_on(before, after)) == 1:
            assert before.pose_world_tcp is not None
            assert after.pose_world_tcp is not None
            travel = before.pose_world_tcp.distance_to(after.pose_world_tcp)
            return f"; write MovePose '{pose}' ({1e3 * travel:.0f} mm)"
    return ""


def level_poses(state: SymbolicState) -> Iterator[PoseExpression]:
    """Poses beside the present one at the same height, a slide away."""
    symbols = state.scene.symbols
    try:
        here = symbols.parse(state.at or "")
    except InputError:
        return
    for length in COMFORTABLE:
        for offset, sign in SIDES:
            size = float(np.linalg.norm(symbols.offset(offset, here.name)))
            # Tenths of an offset, rounded up.
            factor = math.ceil(10 * length * MIN_SLIDE / max(size, 1e-3)) / 10
            yield here.shift(offset, sign * factor)
