"""Primitives that move the arm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from palpate.errors import InputError
from palpate.geometry.pose import Array, Pose
from palpate.robots.kinematics import reachable, within_joint_limits
from palpate.robots.safety import Expectation
from palpate.vocabulary.base import Blackboard, LeafFailure, Primitive, Resource, Steps
from palpate.vocabulary.state import SymbolicState

FREE_SPEED = 0.25
"""m/s, in free air."""
CARRY_SPEED = FREE_SPEED
"""m/s, with an object between the fingers: as without one, because weighing compares equal passes
over one path."""
CONTACT_SPEED = 0.02
"""m/s, whenever something is or may be touched."""
PROBE_SPEED = 0.015
"""m/s, guarded motions: slow enough that one tick of 20 ms adds less than 1 N on a rigid
surface."""
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
CONTACT_FORCE = 8.0
"""N: the threshold tau_c of the paper, against the force felt in free air at the start of the
motion."""
CONTACT_TORQUE = 3.0
"""N m, likewise."""
PROBE_TRAVEL = 0.30
"""m."""
PRESS_DEPTHS = (0.005, 0.001)
"""m: how far the equilibrium is lowered while sliding, at its beginning and its end: a normal force
that the torque sensors resolve, and that varies, so that what the arm's own friction adds to the
sliding force can be told apart."""
LIFTED = 0.005
"""m: a held object whose bottom is this far above its support is clear of it."""

AXES: dict[str, tuple[float, float, float]] = {
    "+x": (1, 0, 0),
    "-x": (-1, 0, 0),
    "+y": (0, 1, 0),
    "-y": (0, -1, 0),
    "+z": (0, 0, 1),
    "-z": (0, 0, -1),
}


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

    def requires(self, state: SymbolicState) -> list[str]:
        try:
            target = self.target(state)
        except InputError as error:
            return [str(error)]
        if not reachable(state.scene.arm, target, state.scene.pose_world_base):
            x, y, z = target.position
            return [
                f"'{self.pose}' at ({x:.3f}, {y:.3f}, {z:.3f}) m is out of the arm's reach; choose a named pose "
                "nearer to the base or a smaller offset"
            ]
        return []

    def slides(self, state: SymbolicState) -> bool:
        """Whether this would drag the held object along its support."""
        if state.holding is None or state.lifted or state.pose_world_tcp is None:
            return False
        after = self.effects(state)
        return (
            not after.lifted
            and after.pose_world_tcp is not None
            and state.pose_world_tcp.distance_to(after.pose_world_tcp) > LIFTED
        )

    def during(self, state: SymbolicState) -> SymbolicState:
        return replace(state, activity="sliding" if self.slides(state) else "moving", contact=None)

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


def clear_of_support(state: SymbolicState, name: str, pose_world_object: Pose) -> bool:
    """Whether object `name` at that pose hangs free of whatever is below it."""
    body = state.scene.body(name)
    below = state.surface_below(pose_world_object)
    top = below.top_z(state.pose_of(below.name)) if below else -np.inf
    return body.bottom_z(pose_world_object) > top + LIFTED


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

    def requires(self, state: SymbolicState) -> list[str]:
        try:
            target = self.target(state)
        except InputError as error:
            return [str(error)]
        if not within_joint_limits(state.scene.arm, target):
            return [
                f"joint angles {np.round(target, 3).tolist()} rad are beyond the arm's limits; "
                "use 'home_config'"
            ]
        if state.holding and not state.lifted:
            return [
                f"'{state.holding}' stands on its support in the gripper; lift it or open the gripper first"
            ]
        return []

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


class MoveUntilContact(Primitive):
    """Move slowly and compliantly along one axis of the world until something rigid is touched; the
    arm then stays in contact. Probe a surface's height with `-z` from its approach pose with empty
    fingers: a picture is never trusted for heights, and a soft cover is pressed through to what is
        rigid beneath."""

    claims: ClassVar[frozenset[Resource]] = frozenset({"arm"})
    group: ClassVar = "motion"
    timeout: ClassVar[float] = 40.0

    axis: Annotated[
        Literal["+x", "-x", "+y", "-y", "+z", "-z"],
        Field(description="direction of motion, world axes"),
    ]

    def requires(self, state: SymbolicState) -> list[str]:
        if state.pose_world_tcp is None:
            return ["the gripper is not at a known pose; MovePose to an approach pose first"]
        if state.contact:
            return [f"already in contact with '{state.contact}'; MovePose away first"]
        if self.axis == "-z" and state.surface_below(state.pose_world_tcp) is None:
            return [
                f"nothing is below '{state.at}'; go to the approach pose of the surface to probe"
            ]
        if state.holding:
            return [
                f"'{state.holding}' is in the gripper; put it down before probing with the fingertips"
            ]
        return []

    def during(self, state: SymbolicState) -> SymbolicState:
        return replace(state, activity="moving")

    def effects(self, state: SymbolicState) -> SymbolicState:
        touched = None
        if self.axis == "-z" and state.pose_world_tcp is not None:
            below = state.surface_below(state.pose_world_tcp)
            touched = below.name if below else None
        return replace(state, contact=touched, activity="contact")

    def expectation(self, state: SymbolicState) -> Expectation:
        return Expectation(contact=True, holding=state.holding is not None)

    def run(self, blackboard: Blackboard) -> Steps:
        direction = np.array(AXES[self.axis], dtype=float)
        start = blackboard.robot.state.pose_world_tcp
        blackboard.robot.move_axis(direction, PROBE_SPEED, PROBE_TRAVEL)
        yield
        free = blackboard.robot.state.wrench
        yield from guard(
            blackboard,
            lambda: self._touching(blackboard, direction, free),
            f"nothing touched within {PROBE_TRAVEL:.2f} m along {self.axis}; "
            "start nearer, or probe another direction",
        )
        yield from settle(blackboard)
        travelled = blackboard.robot.state.pose_world_tcp.distance_to(start)
        return f"contact after {1e3 * travelled:.0f} mm"

    def _touching(self, blackboard: Blackboard, direction: Array, free: Array) -> bool:
        change = blackboard.robot.state.wrench - free
        return bool(
            change[:3] @ direction > CONTACT_FORCE or np.linalg.norm(change[3:]) > CONTACT_TORQUE
        )
