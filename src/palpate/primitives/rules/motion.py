"""Admissibility of a motion: its effects on the objects around the hand.

The hand and the held object keep clear of everything along the whole path, by exact shapes. The search
is more cautious. The fingers enter and leave an object between them along the vertical only:

        |_____|            |_____|
        |     |            |     |
          ___       ->      |___|
         |   |              |   |
       __|___|__          __|___|__
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from palpate.primitives.rules.clearance import box_hits, is_vertical, straddled_object
from palpate.primitives.rules.collision import collisions
from palpate.primitives.rules.support import dragged_off, leaning
from palpate.primitives.state import HOME_CONFIG, SAME_POSE, SymbolicState, Violation

HELD_UPRIGHT = np.radians(10.0)  # rad, largest lean of a held object against its original vertical


def violations(
    before: SymbolicState, after: SymbolicState, *, may_tilt: bool = False
) -> Iterator[Violation]:
    """Violations of a motion by exact shapes, the cheapest test first; `may_tilt` allows a tilted load."""
    if _same_place(before, after) or after.pose_world_tcp is None:
        return
    # From an unknown pose, only the joint motion to `home_config` is safe.
    if before.pose_world_tcp is None:
        if after.at != HOME_CONFIG:
            yield unknown_start()
        return
    yield from _judge_carrying(before, after, may_tilt)
    yield from collisions(before, after)


def is_cautious(before: SymbolicState, after: SymbolicState) -> bool:
    """True for a straight motion clear of all boxes, and vertical near an object: a quick test."""
    start, end = before.pose_world_tcp, after.pose_world_tcp
    if start is None or end is None:
        return False
    # Objects between the open fingers at either end, which the hand enters or leaves.
    between: list[str] = []
    if before.holding is None:
        between = [name for pose in (start, end) if (name := straddled_object(before, pose))]
    near = between or before.contact or before.lifted != after.lifted
    if near and not is_vertical(start, end):
        return False
    return not box_hits(before, start, end, ignoring=between)


def unknown_start() -> Violation:
    """Violation: the pose of the arm is unknown."""
    return Violation(
        "unknown-start", "the hand's pose is unknown; MoveJoints to 'home_config' first"
    )


def _same_place(before: SymbolicState, after: SymbolicState) -> bool:
    """True if nothing moves."""
    start, end = before.pose_world_tcp, after.pose_world_tcp
    if start is None or end is None:
        return start is end
    if start.distance_to(end) > SAME_POSE or start.angle_to(end) > SAME_POSE:
        return False
    # Equal poses may still differ in joint angles, which a joint motion changes.
    if before.joints is after.joints:
        return True
    if not after.is_bent or before.joints is None or after.joints is None:
        return not after.is_bent
    return bool(np.array_equal(before.joints, after.joints))


def _judge_carrying(
    before: SymbolicState, after: SymbolicState, may_tilt: bool
) -> Iterator[Violation]:
    """Violations of moving the held object: it tilts, or is dragged off."""
    held = before.holding
    if held is None:
        return
    # Compare the lean with the original vertical, then test the support at the end.
    lean = leaning(before, held, after.pose_of(held))
    if lean > HELD_UPRIGHT and not may_tilt:
        yield Violation(
            "tilted",
            f"'{held}' would tilt by {np.degrees(lean):.0f}°; remove this, or keep the hand's "
            "orientation of the grasp",
        )
    lost = dragged_off(before, after)
    if lost:
        yield Violation(
            "unsupported",
            f"'{held}' would be dragged off its support: {lost}; lift it first, or slide it level",
        )
