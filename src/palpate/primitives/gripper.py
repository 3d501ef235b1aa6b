"""Primitives that move the fingers."""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator
from dataclasses import replace
from typing import ClassVar

import numpy as np

from palpate.primitives.base import (
    GRIPPER,
    Blackboard,
    LeafFailure,
    Primitive,
    Steps,
    Surroundings,
    Wait,
)
from palpate.primitives.guarding import median_wrench
from palpate.primitives.load import FingerLoad
from palpate.primitives.rules.collision import finger_collisions
from palpate.primitives.rules.grasp import ungraspable
from palpate.primitives.rules.support import above, would_fall
from palpate.primitives.state import SymbolicState, Violation
from palpate.robots.robot import RobotState
from palpate.robots.safety import Expectation

TOP = "_top"  # Suffix of the name of the pose above an object's top
GRIP_SETTLE = 0.1  # s, rest of the fingers on an object before the grasp counts
# N of both fingers until the object is recognised; a free object withstands it sideways.
GENTLE = 10.0
# m by which the opening may be smaller than believed, due to the error of believed shapes. Pads and
# objects deform by less at `GENTLE`.
NARROWER = 0.0015
# m by which the opening may shrink further at the full grasp force. Light and soft objects deform
# by half of that. An object that is squeezed out yields by its whole width.
YIELDS = 0.005
# m by which the opening may be larger than believed. An object 10 mm off the middle, which one
# finger pushes to the other, tilts this much between the pads.
WIDER = 0.003
SOFT = 0.0005  # m by which the opening must be smaller than believed, to test if the object is soft
SOFTEST = 0.6  # Least opening at `GENTLE`, as a fraction of the width; the full force takes as much at most


def finish_fingers(blackboard: Blackboard, least: float = -math.inf) -> Wait:
    """Wait until the fingers' commanded motion has ended, or they are less than `least` m apart."""
    yield
    while blackboard.robot.state.gripper_moving and blackboard.robot.state.width >= least:
        yield np.inf if math.isinf(least) else None


def grip(
    blackboard: Blackboard, missing: str, force: float | None = None, least: float = -math.inf
) -> Generator[float | None, None, float]:
    """Close the fingers with a force, N, or the full one, and wait until they have settled.

    Returns:
        m between the fingers at rest, or during the motion as soon as it is less than `least`.

    Raises:
        LeafFailure: they met no resistance; `missing` is the cause in the message.
    """
    robot = blackboard.robot
    robot.close_gripper(force)
    yield from finish_fingers(blackboard, least)
    if robot.state.width < least:
        return robot.state.width
    # Let the fingers settle on the object before the grasp is judged.
    start = robot.state.t
    while (now := robot.state.t) - start < GRIP_SETTLE:
        yield GRIP_SETTLE - (now - start)
    if not robot.state.gripping:
        raise LeafFailure(f"the fingers met no resistance: {missing}")
    return robot.state.width


def _open(blackboard: Blackboard) -> Wait:
    blackboard.robot.open_gripper()
    yield from finish_fingers(blackboard)


class OpenGripper(Primitive):
    """Open the fingers fully. A held object must stand on a support: bring it back to the pose
    where it was grasped before opening, or it would fall."""

    claims: ClassVar = GRIPPER
    group: ClassVar = "gripper"
    timeout: ClassVar[float] = 10.0

    def requires(self, state: SymbolicState) -> list[Violation]:
        opening = state.scene.arm.hand.opening
        return [
            *would_fall(state),
            *_would_push(state),
            *finger_collisions(state, opening, state.holding),
        ]

    def effects(self, state: SymbolicState) -> SymbolicState:
        # The contact of a held object with its support ends with the grasp.
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
        name, load = blackboard.state.holding, blackboard.load
        # Open only if the support carries the object. One that never left it is carried. The force that the closing
        # fingers leave in the joints would look like a weight of newtons.
        if name is not None and not load.is_where_it_stood(blackboard.robot.state.pose_world_tcp):
            wrench = yield from median_wrench(blackboard)
            if reason := load.explain_carried_load(wrench):
                raise LeafFailure(
                    f"{reason} of '{name}', which would fall; lower it onto its support first"
                )
        yield from _open(blackboard)
        return f"open to {1e3 * blackboard.robot.state.width:.0f} mm"


class CloseGripper(Primitive):
    """Close the fingers until they meet a physical resistance; fails when nothing is between them,
    or not the believed object. Use it at an object's grasp pose with the gripper open."""

    claims: ClassVar = GRIPPER
    group: ClassVar = "gripper"
    timeout: ClassVar[float] = 10.0

    def requires(self, state: SymbolicState) -> list[Violation]:
        if state.gripper != "open":
            problem = "the gripper must be open before it closes; OpenGripper first"
        elif state.pose_world_tcp is None or state.is_bent or state.activity == "contact":
            problem = f"the gripper is not at a grasp pose; MovePose to {_nearest(state)} first"
        elif (body := state.object_at(state.pose_world_tcp)) is None:
            problem = f"no object is between the fingers at '{state.at}'; MovePose to {_nearest(state)} first"
        else:
            return ungraspable(state, body)
        return [Violation("gripper-state", problem)]

    def effects(self, state: SymbolicState) -> SymbolicState:
        body = state.object_at(state.pose_world_tcp)
        if body is None or state.pose_world_tcp is None:
            return replace(state, gripper="closed")
        return replace(
            state,
            gripper="closed",
            holding=body.name,
            grasp=state.at,
            lifted=False,
            pose_tcp_object=state.pose_world_tcp.inverse() @ state.pose_of(body.name),
            activity="contact",
            contact=None,
        )

    def observed(self, after: SymbolicState, robot: RobotState) -> SymbolicState:
        """State with the pose of the grasped object corrected: its middle is between the fingers."""
        name, tool = after.holding, after.pose_world_tcp
        if name is None or tool is None or after.pose_tcp_object is None:
            return after
        body = after.scene.body(name)
        held = None if after.belief_of(name) is None else after.grip_of(body, tool)
        if held is None:
            return after
        # The pads centre the object along the closing direction, and may have pushed it.
        aside = np.array([0.0, held.aside, 0.0])
        middle, along = tool.apply(aside), tool.rotation[:, 1]
        apart = float(along @ (robot.pose_world_tcp.position - middle))
        free = (after.scene.arm.hand.opening - held.width) / 2.0
        centred = replace(after, pose_tcp_object=after.pose_tcp_object.translate(-aside))
        return centred.touched(name, "fingers", along, middle, apart, pushed=free)

    def expectation(self, state: SymbolicState) -> Expectation:
        return Expectation(contact=True)

    def run(self, blackboard: Blackboard) -> Steps:
        robot = blackboard.robot
        # The wrench of the empty fingers is the reference of all later loads.
        blackboard.load = FingerLoad((yield from median_wrench(blackboard)))
        blackboard.set_reflex(robot.limits.reflexes.contact)
        # Close gently first, to compare the width with the believed one before the object moves.
        met = yield from self._close(blackboard, GENTLE)
        believed, doubt = _believed_width(blackboard.state)
        # A soft object is narrower under twice the force, and wider without any: w0 = w1 + (w1 - w2).
        gives = 0.0
        if believed - met > SOFT and met > SOFTEST * believed:
            gives = max(met - (yield from self._close(blackboard, 2.0 * GENTLE)), 0.0)
        unpressed = met + gives
        if unpressed < believed - NARROWER - doubt or unpressed > believed + WIDER + doubt:
            yield from _open(blackboard)
            share = met / believed - 1.0
            raise LeafFailure(
                f"the fingers closed to {1e3 * met:.1f} mm instead of the expected {1e3 * believed:.1f} mm, "
                f"{100 * share:+.0f} %: the object is not at its believed pose; look again"
                f"{_picture_advice(blackboard.state)}"
            )
        # At the full force, a larger travel than that of a linear spring shows that the object escapes.
        most = YIELDS + gives * (blackboard.scene.arm.hand.force / GENTLE - 1.0)
        width = yield from self._close(blackboard, None, met - most)
        if met - width > most or width < (1.0 - SOFTEST) * believed:
            yield from _open(blackboard)
            raise LeafFailure(
                f"the object yielded from {1e3 * met:.1f} to {1e3 * width:.1f} mm under the full force: "
                "it is not at its believed pose; look again"
                f"{_picture_advice(blackboard.state)}"
            )
        blackboard.load = replace(
            blackboard.load, width=width, gives=met - width, grasped_at=robot.state.pose_world_tcp
        )
        return f"grasped at {1e3 * width:.1f} mm"

    def _close(
        self, blackboard: Blackboard, force: float | None, least: float = -math.inf
    ) -> Generator[float | None, None, float]:
        """`grip` with a force, N, or the full one; returns the opening, m."""
        missing = f"no object is between them{_picture_advice(blackboard.state)}"
        return (yield from grip(blackboard, missing, force, least))


def _picture_advice(state: SymbolicState) -> str:
    """Advice for an object that was seen in a picture or by a camera; else empty."""
    body = state.object_at(state.pose_world_tcp)
    # A camera states a covariance of the pose, a picture also an uncertain size.
    if body is not None and body.covariance is not None and not body.seen:
        x, y, _ = state.pose_of(body.name).position
        return f"; '{body.name}' was seen at ({x:.3f}, {y:.3f}) m, to {1e3 * body.doubt:.1f} mm (3 std)"
    if body is None or not body.seen:
        return ""
    wide, deep, high = 1e3 * body.size
    x, y, _ = state.pose_of(body.name).position
    return (
        f"; in the picture '{body.name}' is {wide:.0f} x {deep:.0f} x {high:.0f} mm, at "
        f"({x:.3f}, {y:.3f}) m: take a new picture, or state its pose in poses.yaml"
    )


class FoldFingers(Primitive):
    """Close the empty fingers on each other, making one narrow tip; fails when something is
    between them.

    Fold them at `<object>_top`, touch the top with MoveUntilContact -z, MovePose away,
    OpenGripper."""

    claims: ClassVar = GRIPPER
    group: ClassVar = "gripper"
    timeout: ClassVar[float] = 10.0

    @classmethod
    def groundings(cls, around: Surroundings) -> Iterator[FoldFingers]:
        # Only an object touched from above needs a narrow tip.
        if any(pose.endswith(TOP) for pose in around.poses):
            yield cls()

    def requires(self, state: SymbolicState) -> list[Violation]:
        problem = None
        if state.gripper != "open":
            problem = "the gripper must be open before the fingers fold; OpenGripper first"
        elif state.pose_world_tcp is None or state.activity == "contact":
            problem = "the gripper is not in free air; MovePose to `<object>_top` first"
        elif state.object_at(state.pose_world_tcp) is not None:
            problem = f"an object is between the fingers at '{state.at}'; MovePose away first"
        return [Violation("gripper-state", problem)] if problem else []

    def effects(self, state: SymbolicState) -> SymbolicState:
        return replace(state, gripper="closed")

    def run(self, blackboard: Blackboard) -> Steps:
        blackboard.robot.close_gripper(GENTLE)
        yield from finish_fingers(blackboard)
        if blackboard.robot.state.gripping:
            raise LeafFailure("the fingers closed on an object that the scene does not have there")
        return f"folded to {1e3 * blackboard.robot.state.width:.0f} mm"


def _would_push(state: SymbolicState) -> Iterator[Violation]:
    """Violation of opening folded fingers that press on a body, which they would push aside."""
    if state.contact is None or state.holding is not None or state.gripper != "closed":
        return
    yield Violation(
        "gripper-state",
        f"the folded fingers press on '{state.contact}' and would push it as they open; "
        f"MovePose to '{above(state, state.at)}' first",
    )


def _nearest(state: SymbolicState) -> str:
    """Name of the grasp pose of the object nearest to the hand, as text."""
    here = state.pose_world_tcp
    if here is None or not state.scene.objects:
        return "`<object>_pose`"
    nearest = min(state.scene.objects, key=lambda name: state.pose_of(name).distance_to(here))
    return f"'{nearest}_pose'"


def _believed_width(state: SymbolicState) -> tuple[float, float]:
    """Believed opening, m, of the fingers closed on the object between them, and its doubt, m."""
    # The opening is nan without an object, or for an unknown size: no width exceeds or falls below
    # nan.
    pose, body = state.pose_world_tcp, state.object_at(state.pose_world_tcp)
    if pose is None or body is None:
        return math.nan, 0.0
    # An unknown size gives no width to compare with.
    held = state.grip_of(body, pose)
    width = math.nan if held is None or "size" in body.missing else held.width
    # The size of a shape seen in a picture is as uncertain as its position: 2 σ.
    return width, 2.0 * (body.accuracy or 0.0) if body.seen else 0.0
