"""Breadth-first search over symbolic states for the fewest steps to a goal.

The search tests bounding boxes in every state. The exact check is slow and tests only a complete
path. The next search excludes the refused steps.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from palpate.common.pose import Pose
from palpate.planning.symbolic.steps import Step, is_away, is_clear
from palpate.primitives.base import Primitive
from palpate.primitives.state import PRECONDITION, RESTORED_POSITION, SymbolicState, Violation

MAX_STATES = 5000  # Maximum number of states per search
FEW_STATES = 60  # Maximum number of states in the search for a reason
MOVE_OR_CLEAR = "make room: move it or its neighbours"
MOVE_OR_TURN = "move it nearer to the middle of the arm's reach, or turn it"
# Advice to the user by rule.
ADVICE: Mapping[str, str] = {
    "twist": "place it so that the fingers can grasp it near its centre of mass, or state its mass",
    "blocked": MOVE_OR_CLEAR,
    "collision": MOVE_OR_CLEAR,
    "unreachable": MOVE_OR_TURN,
    "self-collision": MOVE_OR_TURN,
    "unsupported": "move it away from the edge, or clear its top",
    "too-wide": "turn it so that a narrower side faces the fingers",
}
Goal = Callable[[SymbolicState], bool]
# Remaining steps from a state to the goal; None if the goal is not reachable from it.
Tail = Callable[[SymbolicState], "list[Step] | None"]
# Key of a state, and the label of a step that the exact check refuses there.
Refusal = tuple[tuple[object, ...], str]


def at_rest(name: str) -> Goal:
    """Goal: the hand is empty, open and clear, and `name` is at its scene pose."""
    return lambda state: is_clear(state) and not is_away(state, name)


def placement_goal(name: str, pose_world_object: Pose) -> Goal:
    """Goal: the hand is empty, open and clear, and `name` is at the given pose."""

    def matches(state: SymbolicState) -> bool:
        distance = state.pose_of(name).distance_to(pose_world_object)
        return is_clear(state) and distance < RESTORED_POSITION

    return matches


def when(done: Goal) -> Tail:
    """Return a tail without steps that applies once `done` holds."""
    return lambda state: [] if done(state) else None


def shortest(
    start: SymbolicState, operators: Sequence[Primitive], tail: Tail, refused: set[Refusal]
) -> tuple[list[Step], SymbolicState] | None:
    """Find a shortest path, ties by the order of `operators`; return its steps with `tail`, and the final state."""
    queue: deque[tuple[SymbolicState, tuple[Step, ...]]] = deque([(start, ())])
    seen = {state_key(start)}
    # First in, first out: the first path that reaches the goal is a shortest one.
    while queue and len(seen) < MAX_STATES:
        state, steps = queue.popleft()
        rest = tail(state)
        if rest is not None and (after := final_state(state, rest, refused)) is not None:
            return [*steps, *rest], after
        # Expand the state by every operator that applies and is not refused.
        for operator in operators:
            after = Step((operator,)).apply(state)
            if after is None or (state_key(state), operator.label) in refused:
                continue
            key = state_key(after)
            if key not in seen:
                seen.add(key)
                step = Step((operator,), touches=after.contact is not None)
                queue.append((after, (*steps, step)))
    return None


def final_state(
    state: SymbolicState, steps: Iterable[Step], refused: set[Refusal]
) -> SymbolicState | None:
    """Return the state after the steps; None if one of them is `refused`."""
    for step in steps:
        # Refused steps are excluded only in the state of the refusal.
        if refused and (state_key(state), step.label) in refused:
            return None
        state = step.effect(state)
    return state


def find_first_refusal(
    state: SymbolicState, steps: Iterable[Step]
) -> tuple[Refusal, Violation] | None:
    """Return the first step that the exact check refuses, with its violation."""
    for step in steps:
        harm = step.harm(state)
        if harm is not None:
            return (state_key(state), step.label), harm
        state = step.effect(state)
    return None


def obstacle(state: SymbolicState, operators: Sequence[Primitive]) -> str:
    """Return a reason why no sequence of actions leads on, with advice to the user.

    An object would tip, fall or turn in the grip, for example. Violations of the action order are
    no reasons.
    """
    # Explore a few states, and report the first physical violation of a gripper action.
    queue, seen = deque([state]), {state_key(state)}
    while queue and len(seen) < FEW_STATES:
        current = queue.popleft()
        for operator in operators:
            # Violations of the action order are no reasons for the user.
            for violation in operator.requires(current) if "gripper" in operator.claims else ():
                if violation.rule not in (PRECONDITION, "gripper-state", "unknown-start"):
                    return reason(violation)
            after = Step((operator,)).apply(current)
            if after is not None and state_key(after) not in seen:
                seen.add(state_key(after))
                queue.append(after)
    return ""


def reason(violation: Violation) -> str:
    """State a violation as a reason for the user, with advice on how to change the scene."""
    advice = ADVICE.get(violation.rule)
    return f"{violation.finding}; {advice}" if advice else violation.finding


def state_key(state: SymbolicState) -> tuple[object, ...]:
    """Key of a state, with positions rounded to 0.1 mm."""
    poses: list[object] = []
    for name, pose in sorted(state.moved.items()):
        poses.append((name, *np.round(pose.position, 4).tolist()))
    # State of the hand, then the moved objects in order of their names.
    hand = (state.at, state.gripper, state.holding, state.grasp, state.lifted, state.contact)
    return *hand, *poses
