"""Step of a plan under construction: its effect, and this planner's preferences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, cast

from palpate.errors import InputError
from palpate.planning.plan import Node
from palpate.scene.raised import TEMPORARY
from palpate.vocabulary.admissible import motion
from palpate.vocabulary.admissible.clearance import straddled
from palpate.vocabulary.admissible.support import surfaces_slid_on
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

TURNED = 0.1
"""rad by which an object may be turned and still count as restored."""
SLIDE = 0.06
"""m: least length of a slide for friction."""
ASIDE = 0.03
"""m: least length of its way along the other axis."""


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
            InputError: it goes to an unknown pose.
        """
        moving, sensing = self.moving, self.sensing
        branches = [sensing] if sensing else []
        meanwhile = during(moving, state) if sensing else state
        return parallel(state, meanwhile, moving, branches, lambda leaf, before: before.after(leaf))

    def applied(self, state: SymbolicState) -> SymbolicState | None:
        """The state after it; None where it breaks a precondition, or is not preferred."""
        moving, sensing = self.moving, self.sensing
        try:
            meanwhile = during(moving, state) if sensing else state
            if any(primitive.violations(meanwhile) for primitive in sensing):
                return None
            # The effects of a guarded motion take long: not where it is refused.
            if any(state.unmet(primitive) for primitive in moving):
                return None
            after = self.effect(state)
        except InputError:
            return None
        preferred = (is_preferred(one, state, after, recorded=bool(sensing)) for one in moving)
        return after if all(preferred) else None

    def node(self) -> Node:
        """Node of a plan, with the primitives' arguments as they are written in a file."""
        made: list[Node] = []
        for primitive in self.primitives:
            arguments: list[tuple[str, Any]] = []
            for name, value in primitive.model_dump(mode="json", exclude_none=True).items():
                if isinstance(value, list):
                    value = tuple(cast("list[object]", value))
                arguments.append((name, value))
            made.append(Node(type(primitive).__name__, tuple(arguments)))
        return made[0] if len(made) == 1 else Node("Parallel", children=tuple(made))


def is_preferred(
    primitive: Primitive, before: SymbolicState, after: SymbolicState, recorded: bool
) -> bool:
    """True if this planner takes an action: it is stricter than the check, and takes no detours.

    `recorded`: something is sensed beside it.
    """
    if before.pose_world_tcp is None:
        return after.at == HOME_CONFIG
    if "arm" not in primitive.claims:
        if after.gripper != "closed":
            return releases_in_place(before)
        # The empty hand closes only above the top of an object, to probe it with its fingertips.
        probes = after.at is not None and after.at.endswith(TOP)
        return probes or after.holding is not None
    if after.contact:
        # A guarded motion begins in free air.
        return not before.contact and not straddles(before)
    if after.is_bent:
        # The joints move with a free hand.
        return not (before.contact or before.holding or straddles(before))
    if after.at == before.at and not before.contact and not (primitive.tilts and recorded):
        return False
    dragged = before.holding is not None and not before.lifted and not after.lifted
    if dragged and not slides_well(before, after, recorded):
        return False
    return motion.is_cautious(before, after)


def releases_in_place(before: SymbolicState) -> bool:
    """True if an object is released where and as the scene has it, or at its temporary place; or if the
    hand is closed and empty."""
    held = before.holding
    if before.gripper == "open" or held is None:
        return before.gripper != "open"
    turned = before.pose_of(held).angle_to(before.scene.body(held).pose_world)
    if not is_away(before, held) and turned < TURNED:
        return True
    return before.at == f"{held}{TEMPORARY}"


def slides_well(before: SymbolicState, after: SymbolicState, recorded: bool) -> bool:
    """True if an object is slid straight on one surface, far enough for its friction to be recorded, or
    back to where it was found."""
    if before.pose_world_tcp is None or after.pose_world_tcp is None:
        return False
    if after.pose_world_tcp.angle_to(before.pose_world_tcp) > SAME_POSE:
        return False
    # The estimate of a friction takes every drag, recorded or not.
    if len(surfaces_slid_on(before, after)) != 1:
        return False
    travel = after.pose_world_tcp.distance_to(before.pose_world_tcp)
    if recorded:
        return travel >= SLIDE - RESTORED_POSITION
    if travel >= 2 * SLIDE or (after.grasp or "").endswith(TEMPORARY):
        return False
    return not is_away(after, after.holding or "")


def straddles(state: SymbolicState) -> bool:
    """True if an object stands between the open fingers."""
    return not state.holding and straddled(state, state.pose_world_tcp) is not None


def is_away(state: SymbolicState, name: str) -> bool:
    """True if an object is not where the scene has it."""
    return name in state.not_restored()


def is_clear(state: SymbolicState) -> bool:
    """True if the hand is open, empty, and free of contact."""
    idle = state.gripper == "open" and not state.holding and not state.contact
    return idle and not straddles(state)


def nodes(steps: Sequence[Step]) -> Iterator[Node]:
    """The steps as nodes: sensing is grouped with the contact that it follows, as one Sequence."""
    group: list[Node] = []
    for i, step in enumerate(steps):
        group.append(step.node())
        sensing_follows = i + 1 < len(steps) and not steps[i + 1].moving
        if sensing_follows and (step.touches or step.sensing or not step.moving):
            continue
        yield Node("Sequence", children=tuple(group)) if len(group) > 1 else group[0]
        group = []
