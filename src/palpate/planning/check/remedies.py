"""Remedies in a finding: alternative motions that break no rule."""

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

COLLIDING = ("blocked", "collision", "self-collision")  # Rules that another path may satisfy
HIGHER = (0.25, 0.5, 1.0, 1.5, 2.0, 3.0)  # Multiples of z_offset for higher candidate poses
# Multiples of `MIN_SLIDE` for a proposed slide: well above the minimum, else slightly above it.
COMFORTABLE = (1.5, 1.1)
# Directions of a proposed slide; along the object first.
SIDES = (("x_offset", 1), ("x_offset", -1), ("y_offset", 1), ("y_offset", -1))


def offer_remedies(
    primitive: Primitive, before: SymbolicState, violations: Sequence[Violation]
) -> list[Violation]:
    """Replace the advice on collisions by a path that avoids them, if one exists.

    The first collision names the path. The others only state the obstacle.
    """
    # A collision message with "first", such as opening the fingers first, already has a remedy.
    colliding = [
        each
        for each in violations
        if each.rule in COLLIDING and not (each.rule == "collision" and " first" in each.message)
    ]
    path = alternative(primitive, before) if colliding else ""
    if not path:
        return list(violations)
    # Keep the statement of each problem and replace its advice.
    changed: list[Violation] = []
    for each in violations:
        problem = each.message.partition("; ")[0]
        if each is colliding[0]:
            each = replace(each, message=f"{problem}; {path}")
        elif each in colliding:
            each = replace(each, message=problem)
        changed.append(each)
    return changed


def alternative(primitive: Primitive, before: SymbolicState) -> str:
    """Return another path to the same pose, or a higher pose, in words; empty if none exists."""
    # Joint motions have one alternative: the home configuration.
    if isinstance(primitive, MoveJoints):
        home = MoveJoints(joints=HOME_CONFIG)
        return "" if home.violations(before) else f"write MoveJoints '{HOME_CONFIG}'"
    if not isinstance(primitive, MovePose):
        return ""
    above = raise_expression(primitive.pose, before)
    # Move up from the start and across above the goal, as low as possible; else only across.
    starts = raise_expression(before.at or "", before)
    for number, across in enumerate(above):
        via = [*starts[number : number + 1], across]
        if is_free([*(MovePose(pose=pose) for pose in via), primitive], before):
            return "go over it, first: " + ", ".join(f"MovePose '{pose}'" for pose in via)
    # To grasp or release an object, a higher pose is no substitute.
    if before.holding:
        at_object = before.scene.symbols.subject(primitive.pose) in (before.holding, None)
    else:
        at_object = before.object_at(primitive.target(before)) is not None
    for pose in () if at_object else above:
        if not MovePose(pose=pose).violations(before):
            return f"write MovePose '{pose}'"
    return ""


def is_free(motions: Sequence[MovePose], state: SymbolicState) -> bool:
    """True if the sequence of motions breaks no rule."""
    for motion in motions:
        if motion.violations(state):
            return False
        state = motion.effects(state)
    return True


def raise_expression(expression: str, state: SymbolicState) -> list[str]:
    """Return the same pose at greater heights, lowest first; empty for an unknown pose."""
    try:
        symbol = state.scene.symbols.parse(expression)
    except InputError:
        return []
    return [str(symbol.shift("z_offset", factor)) for factor in HIGHER]


def unfelt_slide(before: SymbolicState, after: SymbolicState) -> Violation | None:
    """Return the violation of an invalid drag during a force log, or None.

    The drag is too short, downward, off the support, or across several surfaces. A lift is no
    slide.
    """
    start, end = before.pose_world_tcp, after.pose_world_tcp
    if before.holding is None or before.lifted or start is None or end is None:
        return None
    # Test the slide by its descent, length, support and surfaces, in this order.
    down, travel = float(start.position[2] - end.position[2]), start.distance_to(end)
    if down > LIFTED:
        problem = f"goes {1e3 * down:.0f} mm down, into the support"
    elif slides(before, after) and travel < MIN_SLIDE:
        # Round down: a length slightly below the minimum must not read as the minimum.
        problem = f"is {math.floor(1e4 * travel) / 10:.1f} mm long"
    elif dragged_off(before, after):
        problem = "leaves the support"
    elif slides(before, after) and len(surfaces_slid_on(before, after)) > 1:
        names = " and ".join(f"'{name}'" for name in dict.fromkeys(surfaces_slid_on(before, after)))
        problem = f"crosses parts of {names} that may differ in friction"
    else:
        return None
    return Violation(
        "short-slide",
        f"the slide of '{before.holding}' to '{after.at}' {problem}; a slide is level, on one surface and at "
        f"least {1e3 * MIN_SLIDE:.0f} mm long{alternative_slide(before)}",
    )


def alternative_slide(before: SymbolicState) -> str:
    """Return a level slide that breaks no rule, in words; empty if none exists."""
    for pose in level_poses(before):
        # The pose must pass the rules of the motion and give a valid slide.
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
    """Yield poses at the same height, one slide length away."""
    symbols = state.scene.symbols
    try:
        symbol = symbols.parse(state.at or "")
    except InputError:
        return
    # Comfortable lengths in all directions first, then lengths near the minimum.
    for length in COMFORTABLE:
        for offset, sign in SIDES:
            size = float(np.linalg.norm(symbols.offset(offset, symbol.name)))
            # Round up to tenths of an offset.
            factor = math.ceil(10 * length * MIN_SLIDE / max(size, 1e-3)) / 10
            yield symbol.shift(offset, sign * factor)
