"""The one judgement of a motion: what it does to the things around the hand.

The hand points down, its fingers open. An object whose top is above the fingertips stands between
them; it is entered from straight above and left straight upwards, or the fingers push it over:

        |_____|            |_____|
        |     |            |     |
          ___       ->      |___|          entered and left along the vertical only
         |   |              |   |
       __|___|__          __|___|__

Everything else stays clear of the hand, and of what it holds, all the way.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from palpate.vocabulary.admissible.clearance import TOUCH, Motion, motion_to, straddled
from palpate.vocabulary.state import SymbolicState
from palpate.vocabulary.violation import PRECONDITION, Violation


@dataclass(frozen=True, slots=True)
class Care:
    """How a motion is judged.

    Attributes:
        margin: m that the hand keeps from objects; negative where boxes may overlap by as much.
        strict: the way to, from and with anything near must be known and vertical; else the hand
            may also leave an object at a slant, farther up than sideways.
    """

    margin: float
    strict: bool


TOLERATED = Care(margin=-TOUCH, strict=False)
"""Of a plan from anybody, and of a leaf before it moves: poses are believed to within `TOUCH`."""
PLANNED = Care(margin=0.0, strict=True)
"""Of a plan of our own. Whatever passes this also passes `TOLERATED`."""


@dataclass(frozen=True, slots=True)
class Passage:
    """What a motion of the arm passes on its way.

    Attributes:
        goal: pose expression that it ends at.
        motion: the straight way; None for a joint motion, and where its start is not known.
        left, entered: object between the open fingers at its start, and at its end.
        near: anything that it leaves, enters, parts from, lifts or sets down.
    """

    goal: str | None
    motion: Motion | None
    left: str | None
    entered: str | None
    near: str | None

    @classmethod
    def of(cls, before: SymbolicState, after: SymbolicState) -> Passage:
        """The passage from one state to the other."""
        end = after.pose_world_tcp
        motion = motion_to(before, end) if end is not None else None
        left = entered = None
        if before.holding is None:
            left = straddled(before, before.pose_world_tcp)
            entered = straddled(before, end)
        near = left or entered or before.contact
        if before.lifted != after.lifted:
            near = before.holding
        return cls(after.at, motion, left, entered, near)


def violations(
    before: SymbolicState, after: SymbolicState, care: Care = TOLERATED
) -> Iterator[Violation]:
    """What speaks against the arm's going from one state to the other, cheapest to find first."""
    if after.at == before.at:
        return
    passage = Passage.of(before, after)
    if after.pose_world_tcp is None:
        # A joint motion is no straight line, so it leaves an object sideways.
        if passage.left:
            yield _pushed("leave to", passage.left)
    elif passage.motion is not None:
        yield from _sideways(passage, passage.motion, care)
        yield from _blocked(passage, passage.motion, care)
    elif care.strict:
        yield Violation(
            PRECONDITION, "where the hand is now is not known; MoveJoints to 'home_config' first"
        )


def _sideways(passage: Passage, motion: Motion, care: Care) -> Iterator[Violation]:
    if motion.vertical:
        return
    changes = passage.entered != passage.left
    if passage.entered and changes:
        yield _pushed("enter from", passage.entered)
    elif passage.left and changes and motion.flat:
        yield _pushed("leave to", passage.left)
    elif passage.near and care.strict:
        yield Violation("sideways", f"near '{passage.near}' the way is straight up or down")


def _blocked(passage: Passage, motion: Motion, care: Care) -> Iterator[Violation]:
    between = [name for name in (passage.left, passage.entered) if name]
    for name in motion.hits(ignoring=between, margin=care.margin):
        yield Violation(
            "blocked",
            f"on the way to '{passage.goal}' the hand would run into '{name}'; go around it, or "
            "carry it away first and back later",
        )


def _pushed(how: str, name: str) -> Violation:
    return Violation(
        "sideways",
        f"the fingers would {how} the side of '{name}' and push it over; MovePose to "
        f"'{name}_pose + z_offset' first",
    )
