"""All joints at once, to a configuration."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from palpate.errors import InputError
from palpate.geometry.pose import Array
from palpate.robots.safety import Expectation
from palpate.vocabulary.admissible.reach import beyond_joint_limits
from palpate.vocabulary.admissible.support import would_be_dragged
from palpate.vocabulary.base import (
    Blackboard,
    Primitive,
    Resource,
    Steps,
    Surroundings,
)
from palpate.vocabulary.motion.arriving import UNDER_WAY, at_rest
from palpate.vocabulary.state import HOME_CONFIG, SymbolicState, pose_of_joints
from palpate.vocabulary.touch import BRIEF, finish, settle
from palpate.vocabulary.violation import Violation


class MoveJoints(Primitive):
    """Move all joints to a named configuration or to seven angles. Start and end every plan at
    `home_config`, from where every pose is reached safely; never call it with an object in the
    gripper that stands on a surface."""

    claims: ClassVar[frozenset[Resource]] = frozenset({"arm"})
    group: ClassVar = "motion"
    timeout: ClassVar[float] = UNDER_WAY

    joints: Annotated[
        str | list[float],
        Field(
            description=(
                "named configuration, e.g. `home_config`, or a list of 7 joint angles in rad"
            )
        ),
    ]

    def target(self, state: SymbolicState) -> Array:
        """Joint angles (7,), rad.

        Raises:
            InputError: unknown name, or not seven numbers.
        """
        if isinstance(self.joints, str):
            return state.scene.symbols.joints(self.joints)
        if len(self.joints) != 7:
            raise InputError(
                f"MoveJoints needs 7 angles, not {len(self.joints)}; or use 'home_config'"
            )
        return np.array(self.joints)

    @classmethod
    def groundings(cls, around: Surroundings) -> Iterator[MoveJoints]:
        yield cls(joints=HOME_CONFIG)

    def requires(self, state: SymbolicState) -> list[Violation]:
        try:
            target = self.target(state)
        except InputError as error:
            rule = "unknown-symbol" if isinstance(self.joints, str) else "unreachable"
            return [Violation(rule, str(error))]
        return beyond_joint_limits(state, target) or would_be_dragged(state)

    def during(self, state: SymbolicState) -> SymbolicState:
        return replace(state, activity="moving", contact=None)

    def effects(self, state: SymbolicState) -> SymbolicState:
        name = self.joints if isinstance(self.joints, str) else None
        joints = self.target(state)
        pose = pose_of_joints(state.scene, joints)
        return replace(at_rest(state, name, pose), joints=joints, activity="still")

    def expectation(self, state: SymbolicState) -> Expectation:
        return Expectation(holding=state.holding is not None, grasped=state.holding is not None)

    def run(self, blackboard: Blackboard) -> Steps:
        reflexes = blackboard.robot.limits.reflexes
        blackboard.robot.set_reflex(
            reflexes.carrying if blackboard.state.holding else reflexes.free
        )
        blackboard.robot.move_joints(self.target(blackboard.state))
        yield from finish(blackboard)
        yield from settle(blackboard, BRIEF)
        return "reached"
