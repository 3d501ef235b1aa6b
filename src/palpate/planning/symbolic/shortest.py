"""Breadth-first search over symbolic states, for the fewest steps to a goal.

Boxes are looked at in every state; what the exact judgement refuses of a way that was found is told to
the next search.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from palpate.planning.symbolic.goals import Tail
from palpate.planning.symbolic.steps import Step
from palpate.vocabulary.base import Primitive
from palpate.vocabulary.state import SymbolicState
from palpate.vocabulary.violation import PRECONDITION, Violation

MAX_STATES = 5000
"""States that one search looks at before it gives up."""
FEW_STATES = 60
"""States that the search for a reason looks at."""
MOVE_OR_CLEAR = "make room: move it, or what stands beside it"
MOVE_OR_TURN = "move it nearer to the middle of the arm's reach, or turn it"
ADVICE: Mapping[str, str] = {
    "twist": "lay it so that the fingers can take it near its centre of mass, or state its mass",
    "blocked": MOVE_OR_CLEAR,
    "collision": MOVE_OR_CLEAR,
    "sideways": MOVE_OR_CLEAR,
    "unreachable": MOVE_OR_TURN,
    "self-collision": MOVE_OR_TURN,
    "unsupported": "move it away from the edge, or clear what stands on it",
    "too-wide": "turn it so that a narrower side faces the fingers",
}
"""Advice to the user by rule."""
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


def first_refused(state: SymbolicState, steps: Iterable[Step]) -> tuple[Refusal, Violation] | None:
    """The first of some steps that the exact judgement does not let pass, and why; it is too slow
    to be asked at every step of a search."""
    for step in steps:
        harm = step.harm(state)
        if harm is not None:
            return (_key(state), step.label), harm
        state = step.effect(state)
    return None


def obstacle(state: SymbolicState, operators: Sequence[Primitive]) -> str:
    """Reason why no sequence of actions leads on, with advice to the user: an object would tip, fall
    or turn in the grip. Violations of the order of actions are not reasons."""
    queue, seen = deque([state]), {_key(state)}
    while queue and len(seen) < FEW_STATES:
        here = queue.popleft()
        for operator in operators:
            taking = "gripper" in operator.claims
            for violation in operator.requires(here) if taking else ():
                if violation.rule not in (PRECONDITION, "gripper-state", "unknown-start"):
                    return reason(violation)
            after = Step((operator,)).applied(here)
            if after is not None and _key(after) not in seen:
                seen.add(_key(after))
                queue.append(after)
    return ""


def reason(violation: Violation) -> str:
    """A violation as a reason for the user: its finding, with advice that changes the scene."""
    advice = ADVICE.get(violation.rule)
    return f"{violation.finding}; {advice}" if advice else violation.finding


def _is_refused(state: SymbolicState, steps: Iterable[Step], refused: set[Refusal]) -> bool:
    for step in steps if refused else ():
        if (_key(state), step.label) in refused:
            return True
        state = step.effect(state)
    return False


def _key(state: SymbolicState) -> tuple[object, ...]:
    """Key of a state: poses to a tenth of a millimetre."""
    moved: list[object] = []
    for name, pose in sorted(state.moved.items()):
        moved.append((name, *np.round(pose.position, 4).tolist()))
    hand = (state.at, state.gripper, state.holding, state.grasp, state.lifted, state.contact)
    return *hand, *moved
