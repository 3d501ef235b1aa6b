"""Admissibility of a motion: its effects on the objects around the hand.

The hand points down with open fingers. An object whose top is above the fingertips stands between
them; the hand enters and leaves vertically, or the fingers push the object over:

        |_____|            |_____|
        |     |            |     |
          ___       ->      |___|          entered along the vertical only, and never
         |   |              |   |           left to where a finger is
       __|___|__          __|___|__

Everything else stays clear of the hand, and of the held object, all the way.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from palpate.geometry.pose import Pose
from palpate.vocabulary.admissible.clearance import STEEP, box_hits, is_vertical, straddled
from palpate.vocabulary.admissible.collision import carry_away, collisions
from palpate.vocabulary.admissible.support import dragged_off, leaning
from palpate.vocabulary.state import HOME_CONFIG, SAME_POSE, SymbolicState
from palpate.vocabulary.violation import Violation

HELD_UPRIGHT = np.radians(10.0)  # rad that a held object may lean against how it stood


def violations(
    before: SymbolicState, after: SymbolicState, *, may_tilt: bool = False
) -> Iterator[Violation]:
    """Violations of the arm's motion between two states, by true shapes, the cheapest test first.

    `may_tilt`: the held object is tilted on purpose.
    """
    if _same_place(before, after) or after.pose_world_tcp is None:
        return
    if before.pose_world_tcp is None:
        if after.at != HOME_CONFIG:
            yield unknown_start()
        return
    aside = list(_sideways(before, after, strict=False))
    yield from aside
    yield from _carried(before, after, may_tilt)
    # Leaving an object sideways is also a collision with it: one finding, and one remedy.
    if not aside:
        yield from collisions(before, after)


def conservative_violations(before: SymbolicState, after: SymbolicState) -> Iterator[Violation]:
    """Violations for a planner that takes no risk: a quick test by boxes, and vertical motion near
    any object."""
    if before.pose_world_tcp is None or after.pose_world_tcp is None:
        yield unknown_start()
        return
    yield from _sideways(before, after, strict=True)
    if after.is_bent:
        return
    start, end = before.pose_world_tcp, after.pose_world_tcp
    between = [name for name in _straddled(before, start, end) if name]
    for name in box_hits(before, start, end, ignoring=between):
        yield Violation(
            "blocked",
            f"on the way to '{after.at}' the hand would run into '{name}'; {carry_away(name)}",
        )


def unknown_start() -> Violation:
    """Violation: the pose of the arm is unknown."""
    return Violation(
        "unknown-start", "where the hand is now is not known; MoveJoints to 'home_config' first"
    )


def _same_place(before: SymbolicState, after: SymbolicState) -> bool:
    """True if nothing moves."""
    start, end = before.pose_world_tcp, after.pose_world_tcp
    if start is None or end is None:
        return start is end
    if start.distance_to(end) > SAME_POSE or start.angle_to(end) > SAME_POSE:
        return False
    if before.joints is after.joints:
        return True
    if not after.is_bent or before.joints is None or after.joints is None:
        return not after.is_bent
    return bool(np.array_equal(before.joints, after.joints))


def _straddled(before: SymbolicState, start: Pose, end: Pose) -> tuple[str | None, str | None]:
    """Objects between the open fingers at the start, and at the end, of a motion."""
    if before.holding is not None:
        return None, None
    return straddled(before, start), straddled(before, end)


def _sideways(before: SymbolicState, after: SymbolicState, strict: bool) -> Iterator[Violation]:
    """Violation: the fingers push an object that they enter or leave; `strict`: vertical motion near
    any object."""
    start, end, bent = before.tcp, after.tcp, after.is_bent
    left, entered = _straddled(before, start, end)
    near = left or entered or before.contact
    if before.lifted != after.lifted:
        near = before.holding
    if bent:
        # A joint motion is no straight line: it approaches and leaves an object sideways.
        enters, leaves = not left, bool(left)
    elif is_vertical(start, end):
        return
    else:
        enters = entered != left
        # Across, a finger pushes the object. Along it the hand may leave: a finger was on either
        # side already, as the paper's hammer is left on the way to its next grasp.
        across = abs(float((end.position - start.position) @ start.rotation[:, 1])) >= STEEP
        leaves = entered != left and (strict or across)
    if entered and enters:
        yield _pushed("enter from", entered, after.at)
    elif left and leaves:
        yield _pushed("leave to", left, before.at)
    elif near and strict and not bent:
        yield Violation("sideways", f"near '{near}' the way is straight up or down")


def _pushed(how: str, name: str, place: str | None) -> Violation:
    above = f"{name}_pose + z_offset"
    if place and "z_offset" not in place:
        above = f"{place} + z_offset"
    return Violation(
        "sideways",
        f"the fingers would {how} the side of '{name}' and push it over; MovePose to '{above}' first",
    )


def _carried(before: SymbolicState, after: SymbolicState, may_tilt: bool) -> Iterator[Violation]:
    """Violations of moving the held object: it tilts, or is dragged off."""
    held = before.holding
    if held is None:
        return
    lean = leaning(before, held, after.pose_of(held))
    if lean > HELD_UPRIGHT and not may_tilt:
        yield Violation(
            "tilted",
            f"'{held}' would be laid over by {np.degrees(lean):.0f}°; remove this, or go where the hand "
            "is as it was when it closed",
        )
    lost = dragged_off(before, after)
    if lost:
        yield Violation(
            "unsupported",
            f"'{held}' would be dragged off what it stands on: {lost}; lift it to carry it, or "
            "slide it level",
        )
