"""Alternatives to a motion that would collide: the same a little higher, or by way of poses above
it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from palpate.errors import InputError
from palpate.vocabulary.base import Primitive
from palpate.vocabulary.motion import MoveJoints, MovePose
from palpate.vocabulary.state import HOME_CONFIG, SymbolicState
from palpate.vocabulary.violation import Violation

MENDED = ("blocked", "collision", "self-collision")
"""Rules that another way may satisfy."""
HIGHER = (0.25, 0.5, 1.0, 1.5, 2.0, 3.0)
"""z_offsets by which a pose is tried higher."""


def remedied(
    primitive: Primitive, before: SymbolicState, found: Sequence[Violation]
) -> list[Violation]:
    """The same violations; where another way avoids what would be run into, the first of these says
    which, and the others what, alone."""
    met = [each for each in found if each.rule in MENDED and not _is_of_the_hand(each)]
    way = instead(primitive, before) if met else ""
    if not way:
        return list(found)
    told: list[Violation] = []
    for each in found:
        what = each.message.partition("; ")[0]
        if each is met[0]:
            each = replace(each, message=f"{what}; {way}")
        elif each in met:
            each = replace(each, message=what)
        told.append(each)
    return told


def _is_of_the_hand(violation: Violation) -> bool:
    """True if it orders something else to be done before, such as opening the fingers."""
    return violation.rule == "collision" and " first" in violation.message


def instead(primitive: Primitive, before: SymbolicState) -> str:
    """Another way to the same end, or an end near it, in words; empty where none is found."""
    if isinstance(primitive, MoveJoints):
        home = MoveJoints(joints=HOME_CONFIG)
        return "" if home.violations(before) else f"write MoveJoints '{HOME_CONFIG}'"
    if not isinstance(primitive, MovePose):
        return ""
    by_way = _over(primitive, before)
    if by_way:
        return f"go over it, first: {', '.join(by_way)}"
    if _is_for_an_object(primitive, before):
        return ""
    for pose in _higher(primitive.pose, before):
        if not MovePose(pose=pose).violations(before):
            return f"write MovePose '{pose}'"
    return ""


def _is_for_an_object(motion: MovePose, before: SymbolicState) -> bool:
    """True if something is taken, or put down, at its end: higher up it would not be."""
    if before.holding:
        return before.scene.symbols.subject(motion.pose) in (before.holding, None)
    return before.object_at(motion.target(before)) is not None


def _over(motion: MovePose, before: SymbolicState) -> list[str]:
    """Motions upwards and across from which the end is reached without harm; none where there are
    none."""
    starts = _higher(before.at or "", before)
    for number, across in enumerate(_higher(motion.pose, before)):
        steps = [*starts[number : number + 1], across]
        if _goes(steps, motion, before):
            return [f"MovePose '{step}'" for step in steps]
    return []


def _goes(steps: Sequence[str], motion: MovePose, state: SymbolicState) -> bool:
    """True if all of these motions, and then `motion`, do no harm."""
    for step in (*(MovePose(pose=pose) for pose in steps), motion):
        if step.violations(state):
            return False
        state = step.effects(state)
    return True


def _higher(expression: str, state: SymbolicState) -> list[str]:
    """The same pose higher up, lowest first; none of what is no pose expression."""
    return list(_raised(expression, state))


def _raised(expression: str, state: SymbolicState) -> Iterator[str]:
    try:
        here = state.scene.symbols.parse(expression)
    except InputError:
        return
    for factor in HIGHER:
        yield str(here.shifted("z_offset", factor))
