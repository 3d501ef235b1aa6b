"""The one judgement of a motion: what it does to the things around the hand.

The hand points down, its fingers open. An object whose top is above the fingertips stands between
them; it is entered from straight above and left straight upwards, or the fingers push it over:

        |_____|            |_____|
        |     |            |     |
          ___       ->      |___|          entered along the vertical only, and never
         |   |              |   |           left to where a finger is
       __|___|__          __|___|__

Everything else stays clear of the hand, and of what it holds, all the way.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from palpate.vocabulary.admissible.clearance import STEEP, Motion, straddled
from palpate.vocabulary.admissible.collision import carry_away, collisions
from palpate.vocabulary.admissible.support import dragged_off, leaning, riders
from palpate.vocabulary.state import HOME_CONFIG, SAME_POSE, SymbolicState
from palpate.vocabulary.violation import Violation

HELD_UPRIGHT = np.radians(10.0)
"""rad that a held object may lean against how it stood."""


@dataclass(frozen=True, slots=True)
class Passage:
    """Obstacles beside a motion of the arm.

    Attributes:
        origin, goal: pose expressions, or joint configurations, that it begins and ends at.
        motion: the straight way; None for a joint motion.
        left, entered: object between the open fingers at its start, and at its end.
        near: anything that it leaves, enters, parts from, lifts or sets down.
    """

    origin: str | None
    goal: str | None
    motion: Motion | None
    left: str | None
    entered: str | None
    near: str | None

    @classmethod
    def of(cls, before: SymbolicState, after: SymbolicState) -> Passage:
        """The passage from one state to the other, both with known poses."""
        start, end = before.pose_world_tcp, after.pose_world_tcp
        assert start is not None
        assert end is not None
        motion = None if after.is_bent else Motion(before, start, end)
        left = entered = None
        if before.holding is None:
            left, entered = straddled(before, start), straddled(before, end)
        near = left or entered or before.contact
        if before.lifted != after.lifted:
            near = before.holding
        return cls(before.at, after.at, motion, left, entered, near)


def violations(
    before: SymbolicState, after: SymbolicState, *, may_tilt: bool = False
) -> Iterator[Violation]:
    """Violations of the arm's motion from one state to the other, the cheapest test first, by the
    real shapes of everything.

    `may_tilt`: what is held may be laid over on purpose.
    """
    if _same_place(before, after) or after.pose_world_tcp is None:
        return
    if before.pose_world_tcp is None:
        if after.at != HOME_CONFIG:
            yield unknown_start()
        return
    aside = list(_sideways(Passage.of(before, after), strict=False))
    yield from aside
    yield from _carried(before, after, may_tilt)
    # Who leaves an object sideways runs into it, too: one finding, and one remedy.
    if not aside:
        yield from collisions(before, after)


def conservative_violations(before: SymbolicState, after: SymbolicState) -> Iterator[Violation]:
    """Conservative violations for a planner that takes no risk: a quick test by boxes, and straight
    vertical motion near anything."""
    if before.pose_world_tcp is None or after.pose_world_tcp is None:
        yield unknown_start()
        return
    passage = Passage.of(before, after)
    yield from _sideways(passage, strict=True)
    if passage.motion is not None:
        yield from _blocked(passage, passage.motion)


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


def _sideways(passage: Passage, strict: bool) -> Iterator[Violation]:
    changes = passage.entered != passage.left
    if passage.motion is None:
        # A joint motion is no straight line: it goes to and from an object sideways.
        if passage.left:
            yield _pushed("leave to", passage.left, passage.origin)
        elif passage.entered:
            yield _pushed("enter from", passage.entered, passage.goal)
    elif passage.motion.vertical:
        return
    elif passage.entered and changes:
        yield _pushed("enter from", passage.entered, passage.goal)
    elif passage.left and changes and (strict or _goes_across(passage.motion)):
        yield _pushed("leave to", passage.left, passage.origin)
    elif passage.near and strict:
        yield Violation("sideways", f"near '{passage.near}' the way is straight up or down")


def _goes_across(motion: Motion) -> bool:
    """True if a straight way leads from one finger towards the other. Along what was between them
    they may leave, as the paper's hammer is left on the way to its next grasp: they were on either
    side of it already."""
    closing = motion.start.rotation[:, 1]
    return abs(float((motion.end.position - motion.start.position) @ closing)) >= STEEP


def _carried(before: SymbolicState, after: SymbolicState, may_tilt: bool) -> Iterator[Violation]:
    """Violation of moving the held object: it is laid over, or something stands on it."""
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
    for name in riders(before, held):
        yield Violation(
            "unsupported",
            f"'{name}' stands on '{held}' and would fall; {carry_away(name)}",
        )


def _blocked(passage: Passage, motion: Motion) -> Iterator[Violation]:
    between = [name for name in (passage.left, passage.entered) if name]
    for name in motion.hits(ignoring=between):
        yield Violation(
            "blocked",
            f"on the way to '{passage.goal}' the hand would run into '{name}'; {carry_away(name)}",
        )


def _pushed(how: str, name: str, place: str | None) -> Violation:
    above = (
        f"{place} + z_offset" if place and "z_offset" not in place else f"{name}_pose + z_offset"
    )
    return Violation(
        "sideways",
        f"the fingers would {how} the side of '{name}' and push it over; MovePose to '{above}' first",
    )
