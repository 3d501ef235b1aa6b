"""Breadth-first search over symbolic states, for the fewest steps to a goal.

Boxes are looked at in every state; what the exact judgement refuses of a way that was found is told to
the next search.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence

import numpy as np

from palpate.planning.symbolic.goals import Tail
from palpate.planning.symbolic.steps import Step
from palpate.vocabulary.base import Primitive
from palpate.vocabulary.state import SymbolicState
from palpate.vocabulary.violation import PRECONDITION

MAX_STATES = 5000
"""States that one search looks at before it gives up."""
FEW_STATES = 60
"""That it looks at again, to say why."""
Refusal = tuple[tuple[object, ...], str]
"""A state, and the label of a step that does harm there."""


def shortest(
    start: SymbolicState, operators: Sequence[Primitive], tail: Tail, refused: set[Refusal]
) -> tuple[list[Step], SymbolicState] | None:
    """Breadth-first search; ties go to the order of `operators`."""
    queue: deque[tuple[SymbolicState, tuple[Step, ...]]] = deque([(start, ())])
    seen = {_key(start)}
    while queue and len(seen) < MAX_STATES:
        state, steps = queue.popleft()
        rest = tail(state)
        if rest is not None and not _is_refused(state, rest, refused):
            for step in rest:
                state = step.effect(state)
            return [*steps, *rest], state
        for operator in operators:
            after = Step((operator,)).applied(state)
            if after is None or (_key(state), operator.label) in refused:
                continue
            key = _key(after)
            if key not in seen:
                seen.add(key)
                step = Step((operator,), touches=after.contact is not None)
                queue.append((after, (*steps, step)))
    return None


def first_refused(state: SymbolicState, steps: Iterable[Step]) -> tuple[Refusal, str] | None:
    """The first of some steps that the exact judgement does not let pass, and why; it is too slow
    to be asked at every step of a search."""
    for step in steps:
        harm = step.harm(state)
        if harm is not None:
            return (_key(state), step.label), str(harm)
        state = step.effect(state)
    return None


def obstacle(state: SymbolicState, operators: Sequence[Primitive]) -> str:
    """What of the things themselves speaks against an action on the way, where none leads on: that one
    would tip, fall or turn in the grip; not the order of actions."""
    queue, seen = deque([state]), {_key(state)}
    while queue and len(seen) < FEW_STATES:
        here = queue.popleft()
        for operator in operators:
            taking = "gripper" in operator.claims
            for violation in operator.requires(here) if taking else ():
                if violation.rule not in (PRECONDITION, "gripper-state", "unknown-start"):
                    return f": {violation}"
            after = Step((operator,)).applied(here)
            if after is not None and _key(after) not in seen:
                seen.add(_key(after))
                queue.append(after)
    return ""


def _is_refused(state: SymbolicState, steps: Iterable[Step], refused: set[Refusal]) -> bool:
    for step in steps if refused else ():
        if (_key(state), step.label) in refused:
            return True
        state = step.effect(state)
    return False


def _key(state: SymbolicState) -> tuple[object, ...]:
    """What tells two states apart: poses to a tenth of a millimetre."""
    moved: list[object] = []
    for name, pose in sorted(state.moved.items()):
        moved.append((name, *np.round(pose.position, 4).tolist()))
    hand = (state.at, state.gripper, state.holding, state.grasp, state.lifted, state.contact)
    return *hand, *moved
