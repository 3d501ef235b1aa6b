"""Primitives that move the fingers."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from palpate.robots.safety import Expectation
from palpate.vocabulary.admissible.collision import finger_collisions
from palpate.vocabulary.admissible.grasp import ungraspable
from palpate.vocabulary.admissible.support import would_fall
from palpate.vocabulary.base import Blackboard, LeafFailure, Primitive, Resource, Steps
from palpate.vocabulary.load import Load
from palpate.vocabulary.state import SymbolicState
from palpate.vocabulary.touch import feel
from palpate.vocabulary.violation import Violation

GRIP_SETTLE = 0.1
"""s: fingers at rest on an object before the grasp counts."""


def finish_fingers(blackboard: Blackboard) -> Steps:
    """Wait until the fingers' commanded motion has ended."""
    yield
    while blackboard.robot.state.gripper_moving:
        yield
    return "stopped"


class OpenGripper(Primitive):
    """Open the fingers fully. A held object must stand on a support: bring it back to the pose
    where it was grasped before opening, or it would fall."""

    claims: ClassVar[frozenset[Resource]] = frozenset({"gripper"})
    group: ClassVar = "gripper"
    timeout: ClassVar[float] = 10.0

    def requires(self, state: SymbolicState) -> list[Violation]:
        opening = state.scene.arm.hand.opening
        return [*would_fall(state), *finger_collisions(state, opening, state.holding)]

    def effects(self, state: SymbolicState) -> SymbolicState:
        touched_through_it = state.activity == "contact" and state.contact is None
        activity = "still" if touched_through_it else state.activity
        return replace(
            state,
            gripper="open",
            holding=None,
            grasp=None,
            pose_tcp_object=None,
            lifted=False,
            activity=activity,
        )

    def expectation(self, state: SymbolicState) -> Expectation:
        return Expectation(holding=state.holding is not None, contact=True)

    def run(self, blackboard: Blackboard) -> Steps:
        name = blackboard.state.holding
        if name is not None:
            wrench = yield from feel(blackboard)
            if reason := blackboard.load.too_much(wrench):
                raise LeafFailure(
                    f"{reason} of '{name}', which would fall; lower it onto its support first"
                )
        blackboard.robot.open_gripper()
        yield from finish_fingers(blackboard)
        return f"open to {1e3 * blackboard.robot.state.width:.0f} mm"


class CloseGripper(Primitive):
    """Close the fingers until they meet a physical resistance; fails when nothing is between them.
    Use it at an object's grasp pose with the gripper open."""

    claims: ClassVar[frozenset[Resource]] = frozenset({"gripper"})
    group: ClassVar = "gripper"
    timeout: ClassVar[float] = 10.0

    def requires(self, state: SymbolicState) -> list[Violation]:
        if state.gripper != "open":
            problem = "the gripper must be open before it closes; OpenGripper first"
            return [Violation("gripper-state", problem)]
        if state.pose_world_tcp is None or state.is_bent or state.activity == "contact":
            problem = "the gripper is not at a grasp pose; MovePose to `<object>_pose` first"
            return [Violation("gripper-state", problem)]
        body = state.object_at(state.pose_world_tcp)
        if body is None:
            problem = (
                f"nothing is between the fingers at '{state.at}'; MovePose to `<object>_pose` first"
            )
            return [Violation("gripper-state", problem)]
        return ungraspable(state, body)

    def effects(self, state: SymbolicState) -> SymbolicState:
        body = state.object_at(state.pose_world_tcp) if state.pose_world_tcp else None
        if body is None or state.pose_world_tcp is None:
            return replace(state, gripper="closed")
        pose_tcp_object = state.pose_world_tcp.inverse() @ state.pose_of(body.name)
        return replace(
            state,
            gripper="closed",
            holding=body.name,
            grasp=state.at,
            lifted=False,
            pose_tcp_object=pose_tcp_object,
            activity="contact",
            contact=None,
        )

    def expectation(self, state: SymbolicState) -> Expectation:
        return Expectation(contact=True)

    def run(self, blackboard: Blackboard) -> Steps:
        blackboard.load = Load((yield from feel(blackboard)))
        blackboard.robot.set_reflex(blackboard.robot.limits.reflexes.contact)
        blackboard.robot.close_gripper()
        yield from finish_fingers(blackboard)
        start = blackboard.robot.state.t
        while blackboard.robot.state.t - start < GRIP_SETTLE:
            yield
        if not blackboard.robot.state.gripping:
            raise LeafFailure("the fingers met no resistance: nothing is between them")
        blackboard.load = replace(blackboard.load, width=blackboard.robot.state.width)
        return f"grasped at {1e3 * blackboard.robot.state.width:.1f} mm"
