"""Step of a plan under construction: its effect, and this planner's preference."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from palpate.errors import InputError
from palpate.planning.nodes import node_of
from palpate.planning.plan import Node
from palpate.vocabulary.admissible import motion
from palpate.vocabulary.admissible.clearance import straddled
from palpate.vocabulary.base import Primitive
from palpate.vocabulary.gripper import TOP
from palpate.vocabulary.state import (
    HOME_CONFIG,
    RESTORED_POSITION,
    SAME_POSE,
    SymbolicState,
    during,
    parallel,
)
from palpate.vocabulary.violation import Violation

TEMPORARY = "_temporary"
"""Ending of the name of the free place to which an object is carried out of the way."""
TURNED = 0.1
"""rad by which an object may be turned and still be as it was."""
SLIDE = 0.06
"""m: how far an object is slid for its friction, at least."""
ASIDE = 0.03
"""m: how far along the other axis."""


@dataclass(frozen=True, slots=True)
class Step:
    """Primitives that run together (in a Parallel when several). `touches`: it ends in contact with
    a surface."""

    primitives: tuple[Primitive, ...]
    touches: bool = False

    @property
    def moving(self) -> list[Primitive]:
        """Primitives that claim the arm or the gripper."""
        return [primitive for primitive in self.primitives if primitive.claims]

    @property
    def sensing(self) -> list[Primitive]:
        """Primitives that only sense or convert."""
        return [primitive for primitive in self.primitives if not primitive.claims]

    @property
    def senses(self) -> bool:
        """True if nothing moves."""
        return not self.moving

    @property
    def leads_to_sensing(self) -> bool:
        """True if sensing after it belongs to it: it senses itself, or touches what is sensed."""
        return self.senses or self.touches or bool(self.sensing)

    @property
    def label(self) -> str:
        """Label for people."""
        return " beside ".join(primitive.label for primitive in self.primitives)

    def harm(self, state: SymbolicState) -> Violation | None:
        """First violation of its motions by the exact judgement of the check, if any."""
        for primitive in self.moving:
            for violation in primitive.violations(state):
                return violation
        return None

    def effect(self, state: SymbolicState) -> SymbolicState:
        """The state after it.

        Raises:
            InputError: it goes to a pose that does not exist.
        """
        moving, sensing = self.moving, self.sensing
        branches = [sensing] if sensing else []
        return parallel(state, during(moving, state), moving, branches, _after)

    def applied(self, state: SymbolicState) -> SymbolicState | None:
        """The state after it; None where something speaks against it, or this planner would not
        take it."""
        moving, sensing = self.moving, self.sensing
        try:
            meanwhile = during(moving, state)
            if any(primitive.violations(meanwhile) for primitive in sensing):
                return None
            after = self.effect(state)
        except InputError:
            return None
        for primitive in moving:
            if not _would_take(primitive, state, after, recorded=bool(sensing)):
                return None
            if primitive.requires(state):
                return None
        return after


def _after(primitive: Primitive, state: SymbolicState) -> SymbolicState:
    return primitive.effects(state)


def _would_take(
    primitive: Primitive, before: SymbolicState, after: SymbolicState, recorded: bool
) -> bool:
    """True if this planner takes an action: it is more careful than the check has to be, and does
    nothing that leads nowhere."""
    if before.pose_world_tcp is None:
        return after.at == HOME_CONFIG
    if "gripper" in primitive.claims:
        folds = after.gripper == "closed" and after.at is not None and after.at.endswith(TOP)
        closes = folds or _closes_on_something(after)
        return closes if after.gripper == "closed" else _lets_go_well(before)
    if after.contact:
        # A guarded motion begins in free air.
        return not before.contact and not _straddles(before)
    if after.is_bent:
        # The joints move with a free hand.
        return not (before.contact or before.holding or _straddles(before))
    if after.at == before.at and not before.contact and not (primitive.tilts and recorded):
        return False
    if _slides(before, after) and not _slides_well(before, after, recorded):
        return False
    return next(motion.conservative_violations(before, after), None) is None


def _straddles(state: SymbolicState) -> bool:
    """True if an object stands between the open fingers."""
    return not state.holding and straddled(state, state.pose_world_tcp) is not None


def _closes_on_something(after: SymbolicState) -> bool:
    return after.holding is not None


def _lets_go_well(before: SymbolicState) -> bool:
    """Objects are let go of where and as the scene has them, or at their temporary place."""
    held = before.holding
    if before.gripper == "open":
        return False
    if held is None:
        return True
    turned = before.pose_of(held).angle_to(before.scene.body(held).pose_world)
    if not is_away(before, held) and turned < TURNED:
        return True
    return before.at == f"{held}{TEMPORARY}"


def _slides(before: SymbolicState, after: SymbolicState) -> bool:
    return before.holding is not None and not before.lifted and not after.lifted


def _slides_well(before: SymbolicState, after: SymbolicState, recorded: bool) -> bool:
    """Objects are slid straight, far enough to be felt, or back to where they were."""
    if before.pose_world_tcp is None or after.pose_world_tcp is None:
        return False
    if after.pose_world_tcp.angle_to(before.pose_world_tcp) > SAME_POSE:
        return False
    travel = after.pose_world_tcp.distance_to(before.pose_world_tcp)
    if recorded:
        return travel >= SLIDE - RESTORED_POSITION
    if travel >= 2 * SLIDE or (after.grasp or "").endswith(TEMPORARY):
        return False
    return not is_away(after, after.holding or "")


def is_away(state: SymbolicState, name: str) -> bool:
    """True if an object is not where the scene has it."""
    return name in state.not_restored()


def is_clear(state: SymbolicState) -> bool:
    """True if the hand is open and empty, and stands free of everything."""
    idle = state.gripper == "open" and not state.holding and not state.contact
    return idle and not _straddles(state)


def nodes(steps: Sequence[Step]) -> Iterator[Node]:
    """The steps as nodes: sensing is grouped with the contact that it follows, as one Sequence."""
    group: list[Node] = []
    for i, step in enumerate(steps):
        group.append(_node(step))
        sensing_follows = i + 1 < len(steps) and steps[i + 1].senses
        if sensing_follows and step.leads_to_sensing:
            continue
        if len(group) > 1:
            yield Node("Sequence", children=tuple(group))
        else:
            yield group[0]
        group = []


def _node(step: Step) -> Node:
    made = tuple(node_of(primitive) for primitive in step.primitives)
    if len(made) == 1:
        return made[0]
    return Node("Parallel", children=made)
