"""Goals of a search: states with a known tail of steps."""

from __future__ import annotations

from collections.abc import Callable

from palpate.geometry.pose import Pose
from palpate.planning.symbolic.steps import Step, is_away, is_clear
from palpate.vocabulary.state import RESTORED_POSITION, SymbolicState

Goal = Callable[[SymbolicState], bool]
Tail = Callable[[SymbolicState], "list[Step] | None"]
"""Remaining steps from a state to the goal; None when the goal is not in reach from there."""


def at_rest(name: str) -> Goal:
    """The hand empty, open and clear, and `name` where the scene has it."""

    def reached(state: SymbolicState) -> bool:
        return is_clear(state) and not is_away(state, name)

    return reached


def placed(name: str, pose_world_object: Pose) -> Goal:
    """The hand empty, open and clear, and `name` at that pose."""

    def reached(state: SymbolicState) -> bool:
        distance = state.pose_of(name).distance_to(pose_world_object)
        return is_clear(state) and distance < RESTORED_POSITION

    return reached


def when(done: Goal) -> Tail:
    """Tail without steps, once `done` holds."""

    def tail(state: SymbolicState) -> list[Step] | None:
        return [] if done(state) else None

    return tail
