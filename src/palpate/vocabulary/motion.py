"""Primitives that move the arm to where it is told."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from palpate.errors import InputError
from palpate.geometry.pose import Array, Pose
from palpate.robots.safety import Expectation
from palpate.vocabulary.admissible.reach import beyond_joint_limits, out_of_reach
from palpate.vocabulary.admissible.support import clear_of_support, slides, would_be_dragged
from palpate.vocabulary.base import (
    Blackboard,
    LeafFailure,
    Primitive,
    Resource,
    Steps,
    Surroundings,
)
from palpate.vocabulary.state import SymbolicState
from palpate.vocabulary.violation import Violation

FREE_SPEED = 0.25
"""m/s, in free air."""
CARRY_SPEED = FREE_SPEED
"""m/s, with an object between the fingers: as without one, because weighing compares equal passes
over one path."""
CONTACT_SPEED = 0.02
"""m/s, whenever something is or may be touched."""
POSITION_TOLERANCE = 0.010
"""m: an impedance-controlled arm with 1.5 kg on it sags by several millimetres."""
ANGLE_TOLERANCE = np.radians(3.0)
SETTLED_SPEED = 0.003
"""m/s."""
DWELL = 0.4
"""s: how long the arm stands still before a motion counts as settled; still windows feed the
estimators."""
SETTLE_LIMIT = 3.0
"""s."""
PRESS_DEPTHS = (0.005, 0.001)
"""m: how far the equilibrium is lowered while sliding, at its beginning and its end: a normal force
that the torque sensors resolve, and that varies, so that what the arm's own friction adds to the
sliding force can be told apart."""
HOME_CONFIG = "home_config"
"""The joint configuration from which every pose is reached safely."""


def settle(blackboard: Blackboard, dwell: float = DWELL) -> Steps:
    """Wait until the arm has stood still for `dwell` s.

    Raises:
        LeafFailure: it does not come to rest.
    """
    start = since = blackboard.robot.state.t
    while blackboard.robot.state.t - since < dwell:
        if np.linalg.norm(blackboard.robot.state.twist[:3]) > SETTLED_SPEED:
            since = blackboard.robot.state.t
        if blackboard.robot.state.t - start > SETTLE_LIMIT + dwell:
            raise LeafFailure(f"the arm does not settle within {SETTLE_LIMIT:g} s")
        yield
    return "settled"


def finish(blackboard: Blackboard) -> Steps:
    """Wait until the arm's commanded motion has ended."""
    yield
    while blackboard.robot.state.moving:
        yield
    return "arrived"


def guard(blackboard: Blackboard, touching: Callable[[], bool], otherwise: str) -> Steps:
    """Wait until the arm's motion touches something, and hold it there.

    Raises:
        LeafFailure: the motion ended first; `otherwise` is the reason given.
    """
    while not touching():
        if not blackboard.robot.state.moving:
            raise LeafFailure(otherwise)
        yield
    blackboard.robot.hold()
    return "touched"


class MovePose(Primitive):
    """Move the gripper in a straight line to a Cartesian equilibrium pose and settle there. Reach
    an object from above: first `<object>_pose + z_offset`, then `<object>_pose`. While an object is
    held on its support, moving sideways at the same height slides it with light pressure; lift it
    first to carry it."""

    claims: ClassVar[frozenset[Resource]] = frozenset({"arm"})
    group: ClassVar = "motion"

    pose: Annotated[
        str,
        Field(
            min_length=1,
            max_length=200,
            description=(
                "pose expression NAME (± [factor *] OFFSET)*, e.g. `bottle_pose + z_offset`, `hammer_pose - 2*x_offset`"
            ),
        ),
    ]

    def target(self, state: SymbolicState) -> Pose:
        """The TCP pose in the world that the expression stands for."""
        return state.scene.symbols.resolve(self.pose)

    @classmethod
    def groundings(cls, around: Surroundings) -> Iterator[MovePose]:
        for pose in around.poses:
            yield cls(pose=pose)

    def transferred(self, old: str, new: str) -> MovePose:
        head, *rest = self.pose.split(" ", 1)
        names = {f"{old}{ending}": f"{new}{ending}" for ending in ("_pose", "_approach")}
        return self.model_copy(update={"pose": " ".join([names.get(head, head), *rest])})

    def requires(self, state: SymbolicState) -> list[Violation]:
        try:
            target = self.target(state)
        except InputError as error:
            return [Violation("unknown-symbol", str(error))]
        return out_of_reach(state, target, self.pose)

    def slides(self, state: SymbolicState) -> bool:
        """Whether this would drag the held object along its support."""
        if state.holding is None or state.lifted:
            return False
        return slides(state, self.effects(state))

    def during(self, state: SymbolicState) -> SymbolicState:
        activity = "sliding" if self.slides(state) else "moving"
        return replace(state, activity=activity, contact=None)

    def effects(self, state: SymbolicState) -> SymbolicState:
        target = self.target(state)
        arrived = replace(
            state, at=self.pose, pose_world_tcp=target, contact=None, activity="still"
        )
        if state.holding is None or state.pose_tcp_object is None:
            return arrived
        pose_world_object = target @ state.pose_tcp_object
        lifted = clear_of_support(state, state.holding, pose_world_object)
        return replace(
            arrived,
            lifted=lifted,
            activity="still" if lifted else "contact",
            moved={**state.moved, state.holding: pose_world_object},
        )

    def expectation(self, state: SymbolicState) -> Expectation:
        held = state.holding is not None
        return Expectation(holding=held, grasped=held, contact=held and not state.lifted)

    def run(self, blackboard: Blackboard) -> Steps:
        target = self.target(blackboard.state)
        if blackboard.state.activity == "sliding":
            yield from self._slide(blackboard, target)
        else:
            blackboard.robot.move_pose(
                target, CARRY_SPEED if blackboard.state.holding else FREE_SPEED
            )
            yield from finish(blackboard)
            yield from settle(blackboard)
        return self._arrived(blackboard, target)

    def _slide(self, blackboard: Blackboard, target: Pose) -> Steps:
        first, last = (np.array([0.0, 0.0, -depth]) for depth in PRESS_DEPTHS)
        for waypoint in (
            blackboard.robot.state.target_world_tcp.translated(first),
            target.translated(last),
            target,
        ):
            blackboard.robot.move_pose(waypoint, CONTACT_SPEED)
            yield from finish(blackboard)
            yield from settle(blackboard)
        return "slid"

    def _arrived(self, blackboard: Blackboard, target: Pose) -> str:
        measured = blackboard.robot.state.pose_world_tcp
        distance, angle = measured.distance_to(target), measured.angle_to(target)
        if distance > POSITION_TOLERANCE or angle > ANGLE_TOLERANCE:
            raise LeafFailure(
                f"stopped {1e3 * distance:.1f} mm and {np.degrees(angle):.1f}° from '{self.pose}', "
                f"more than {1e3 * POSITION_TOLERANCE:.0f} mm or {np.degrees(ANGLE_TOLERANCE):.0f}°: "
                "something is in the way, or the pose is at the edge of the arm's reach"
            )
        return f"within {1e3 * distance:.1f} mm"


class MoveJoints(Primitive):
    """Move all joints to a named configuration or to seven angles. Start and end every plan at
    `home_config`, from where every pose is reached safely; never call it with an object in the
    gripper that stands on a surface."""

    claims: ClassVar[frozenset[Resource]] = frozenset({"arm"})
    group: ClassVar = "motion"

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
        return replace(state, at=name, pose_world_tcp=None, contact=None, activity="still")

    def expectation(self, state: SymbolicState) -> Expectation:
        return Expectation(holding=state.holding is not None, grasped=state.holding is not None)

    def run(self, blackboard: Blackboard) -> Steps:
        blackboard.robot.move_joints(self.target(blackboard.state))
        yield from finish(blackboard)
        yield from settle(blackboard)
        return "reached"
