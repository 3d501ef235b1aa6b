"""Controlled stop with a held object: it is put down or held still, never dropped.

It is put down only on a proven support. The support is believed to be below with a margin, and is met
near that height. It carries more than the whole weight, at rest, for `PROVEN` s. In all other cases,
for example at an edge or with a varying force, the object stays in the closed fingers.

A fixture goes back along its joint to where it was found, since it rested there. A door closer, a
spring or gravity would slam it elsewhere.

The rules that judge a plan's motions judge the stop's, too. The fingers open only as far as they meet
no body, and the hand rises only as far as the arm stays clear.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np

from palpate.common.pose import Pose
from palpate.primitives.base import ARM, GRIPPER, Blackboard, LeafFailure, Primitive, Steps, Wait
from palpate.primitives.gripper import finish_fingers
from palpate.primitives.guarding import DOWN, WrenchFilter, finish, settle, wait_for_contact
from palpate.primitives.handle import return_fixture
from palpate.primitives.load import AT_GRASP, UNFELT
from palpate.primitives.motion import state_at_rest
from palpate.primitives.rules import motion
from palpate.primitives.rules.collision import finger_collisions
from palpate.primitives.rules.profile import GUARDED_SPEED, POSE_ERROR
from palpate.primitives.rules.support import footing, is_as_found, stable
from palpate.primitives.state import SymbolicState
from palpate.robots.safety import Expectation

EXTRA_TRAVEL = 0.015
"""m of travel below the believed support: covers sag of the arm, pose error and a soft support."""
PRESSED = 5.0
"""N on the support in addition to the whole weight, until the support counts as met."""
STILL_PRESSED = 2.0  # N of that force that must remain during `PROVEN`
PROVEN = 0.5  # s at rest for which the support must carry the object
PRESSES = 3
"""Number of presses, each by `PRESSED` more.

An object that hung askew between the pads turns until it lies flat, and yields meanwhile.
"""
STAYS = "it stays in the fingers"
RETREAT_SPEED = 0.05  # m/s, speed of the retreat upwards
RETREATS = (0.10, 0.06, 0.03)  # m, lengths of the retreat upwards that are tried in order
OPENINGS = (np.inf, 0.02, 0.01)  # m beyond the object's width that are tried in order
TILTED = np.radians(3.0)  # rad from the hand's pose before a motion: more, and it turns back first

Fate = Literal["put down", "held", "lost"]


@dataclass(frozen=True, slots=True)
class HeldObject:
    """Object in the fingers at the stop of a run, and its fate.

    Attributes:
        object: its name; None for an object that was just grasped.
        became: `put down` on a support that carries it; still `held`; or `lost`: it slipped out of the
            fingers, and its place is unknown.
    """

    object: str | None
    became: Fate

    @property
    def name(self) -> str:
        """Name for people."""
        return f"'{self.object}'" if self.object else "what was grasped"

    @property
    def warning(self) -> str | None:
        """Warning about the object; None if it was put down."""
        if self.became == "held":
            return f"the fingers still hold {self.name}"
        if self.became == "lost":
            return (
                f"{self.name} was not put down and is not in the fingers any more: see where it is"
            )
        return None


class PutDown(Primitive):
    """Lower the held object until its support carries its weight, open the fingers, retreat upwards.

    Without a proven support it fails, and leaves the object in the closed fingers. It is not part of
    the vocabulary: only the runner uses it, in a controlled stop.
    """

    claims: ClassVar = ARM | GRIPPER
    group: ClassVar = "motion"
    timeout: ClassVar[float] = 60.0

    def expectation(self, state: SymbolicState) -> Expectation:
        # The retreat is a motion in free air.
        held = state.holding is not None
        return Expectation(contact=held or state.activity != "moving", grasped=held)

    def slipping(self, blackboard: Blackboard) -> str | None:
        """None: a slipping object is put down as well, as long as the fingers have it."""
        return None

    def run(self, blackboard: Blackboard) -> Steps:
        robot, name = blackboard.robot, blackboard.state.holding
        blackboard.set_reflex(robot.limits.reflexes.contact)
        if name is not None and name in blackboard.scene.fixtures:
            yield from self._back_to_rest(blackboard, name)
        elif name is not None:
            yield from self._turn_back(blackboard)
            yield from self._to_support(blackboard, name)
        width, reason = clear_opening(blackboard)
        if reason is not None:
            raise LeafFailure(f"the fingers cannot open, {reason}: {STAYS}")
        blackboard.state = state_after_release(blackboard)
        robot.open_gripper(width)
        yield from finish_fingers(blackboard)
        done = f"put {name or 'what was just grasped'} down"
        rises = yield from self._retreat(blackboard)
        return done if rises else f"{done}; the hand stays there, since the way up is not clear"

    def _back_to_rest(self, blackboard: Blackboard, name: str) -> Wait:
        """Return a fixture to where it was found."""
        try:
            yield from return_fixture(blackboard)
        except LeafFailure as failure:
            raise LeafFailure(
                f"'{name}' is not back where it was found, {failure}: {STAYS}"
            ) from None

    def _turn_back(self, blackboard: Blackboard) -> Wait:
        """Turn the hand back to its orientation before the motion that was stopped, if that is clear."""
        robot, state = blackboard.robot, blackboard.state
        now = robot.state.pose_world_tcp
        if state.pose_world_tcp is None or now.angle_to(state.pose_world_tcp) < TILTED:
            return
        upright = Pose(now.position, state.pose_world_tcp.quaternion)
        here, there = (state_at_rest(state, state.at, pose) for pose in (now, upright))
        if any(motion.violations(here, there)):
            return
        robot.move_pose(upright, RETREAT_SPEED)
        yield from finish(blackboard)
        yield from settle(blackboard)

    def _retreat(self, blackboard: Blackboard) -> Generator[float | None, None, bool]:
        """Rise as far as the arm stays clear; False if it is not clear at all."""
        robot = blackboard.robot
        blackboard.set_out()
        here = blackboard.state
        for rise in RETREATS:
            there = state_at_rest(here, None, here.tcp.translate((0.0, 0.0, rise)))
            if not any(motion.violations(here, there)):
                break
        else:
            return False
        blackboard.state = replace(here, activity="moving")
        blackboard.set_reflex(robot.limits.reflexes.free)
        robot.move_axis(-DOWN, RETREAT_SPEED, rise)
        yield from finish(blackboard)
        yield from settle(blackboard)
        blackboard.state = there
        return True

    def _to_support(self, blackboard: Blackboard, name: str) -> Wait:
        """Lower the object onto a support; an object that was never lifted is on it already."""
        state, held = blackboard.state, held_pose(blackboard)
        # The place where the object would stand, straight below.
        gap = footing(state, name, held).gap
        place = held.translate((0.0, 0.0, -gap)) if np.isfinite(gap) else held
        if reason := unproven(state, name, place) or self._in_the_way(blackboard, place):
            raise LeafFailure(f"'{name}' cannot be put down here, {reason}: {STAYS}")
        # Without a grasp pose, `lifted` alone decides if the object is on its support.
        height = 0.0
        if state.grasp is not None:
            tcp = blackboard.robot.state.pose_world_tcp
            height = float(tcp.position[2] - state.resolve(state.grasp).position[2])
        if state.lifted or height > AT_GRASP:
            yield from self._lower(blackboard, name, place)

    def _in_the_way(self, blackboard: Blackboard, place: Pose) -> str | None:
        """Obstacle on the way down to `place` of the object; None if the way is clear."""
        state, held = blackboard.state, blackboard.state.pose_tcp_object
        if held is None:
            return None
        here = state_at_rest(state, state.at, blackboard.robot.state.pose_world_tcp)
        there = state_at_rest(here, "its support", place @ held.inverse())
        found = next(motion.violations(here, there), None)
        return None if found is None else found.message.partition(";")[0]

    def _lower(self, blackboard: Blackboard, name: str, place: Pose) -> Wait:
        """Move down until the support carries the object.

        Raises LeafFailure: no support, an obstacle above it, or a support that yields.
        """
        robot, filtered, load = blackboard.robot, WrenchFilter(blackboard.robot), blackboard.load
        travel = max(height_above(blackboard, place), 0.0) + EXTRA_TRAVEL
        robot.move_axis(DOWN, GUARDED_SPEED, travel)
        if not (
            yield from wait_for_contact(blackboard, lambda: -load.borne(filtered.now()) > PRESSED)
        ):
            raise LeafFailure(f"no support within {1e3 * travel:.0f} mm below '{name}': {STAYS}")
        yield from finish(blackboard)
        yield from settle(blackboard)
        # A contact well above the believed support is an obstacle.
        early = height_above(blackboard, place)
        if early > POSE_ERROR:
            raise LeafFailure(
                f"'{name}' met something {1e3 * early:.0f} mm above its support: {STAYS}"
            )
        # Press harder until the support carries the object for `PROVEN` s.
        for press in range(PRESSES):
            if press > 0:
                deeper = PRESSED / blackboard.scene.arm.stiffness.translation
                robot.move_axis(DOWN, GUARDED_SPEED, deeper)
                yield from finish(blackboard)
                yield from settle(blackboard)
            if (yield from is_borne(blackboard)):
                return
        raise LeafFailure(f"nothing bears '{name}' for long: {STAYS}")


def clear_opening(blackboard: Blackboard) -> tuple[float, str | None]:
    """Largest of the `OPENINGS`, m, at which the fingers meet no other body.

    If there is none, it is the smallest one, with the reason.
    """
    robot, most = blackboard.robot, blackboard.scene.arm.hand.opening
    tcp = robot.state.pose_world_tcp
    here = replace(blackboard.state, at="this pose", pose_world_tcp=tcp, joints=None)
    between = here.object_at(here.pose_world_tcp)
    around = blackboard.state.holding or (between.name if between else None)
    width, reason = most, None
    for further in OPENINGS:
        width = min(robot.state.width + further, most)
        found = finger_collisions(here, width, around)
        if not found:
            return width, None
        reason = found[0].message.partition(";")[0]
    return width, reason


def let_slip(blackboard: Blackboard) -> bool:
    """Open the fingers at once if an object slips while they press it on its support.

    Fingers that close further would tip it over, so that they open a little even beside a neighbour.
    Returns True if they were opened.
    """
    state, load = blackboard.robot.state, blackboard.load
    # A slip is harmless only while the object presses on its support.
    slips = blackboard.state.holding is not None and load.slip(state.width) is not None
    if not slips or load.borne(state.contact) > -UNFELT:
        return False
    width, _ = clear_opening(blackboard)
    blackboard.robot.open_gripper(width)
    blackboard.state = state_after_release(blackboard)
    return True


def unproven(state: SymbolicState, name: str, place: Pose) -> str | None:
    """Reason why an object might not stay at a place; None if it would stay.

    A new support that is itself an object may be elsewhere, unless the object slid there.
    """
    if state.lifted and not is_as_found(state, name, place):
        for owner in footing(state, name, place).owners:
            if owner in state.scene.objects:
                return f"'{owner}' might tip under it"
    return stable(state, name, place)


def is_borne(blackboard: Blackboard) -> Generator[float | None, None, bool]:
    """Wait for `PROVEN` s; False as soon as the support does not carry the object."""
    robot, filtered = blackboard.robot, WrenchFilter(blackboard.robot)
    start = robot.state.t
    while robot.state.t - start < PROVEN:
        if -blackboard.load.borne(filtered.now()) < STILL_PRESSED:
            return False
        yield
    return True


def held_pose(blackboard: Blackboard) -> Pose:
    """Pose of the held object in the world, from the measured pose of the arm."""
    held = blackboard.state.pose_tcp_object
    tcp = blackboard.robot.state.pose_world_tcp
    return tcp if held is None else tcp @ held


def height_above(blackboard: Blackboard, place: Pose) -> float:
    """Height of the held object above a pose, m."""
    return float(held_pose(blackboard).position[2] - place.position[2])


def state_after_release(blackboard: Blackboard) -> SymbolicState:
    """Symbolic state after the fingers opened at their current pose."""
    state, tcp = blackboard.state, blackboard.robot.state.pose_world_tcp
    # The released object is believed to be at its pose in the hand.
    moved = dict(state.moved)
    if state.holding is not None and state.pose_tcp_object is not None:
        moved[state.holding] = tcp @ state.pose_tcp_object
    return replace(
        state,
        at=None,
        pose_world_tcp=tcp,
        gripper="open",
        holding=None,
        grasp=None,
        pose_tcp_object=None,
        lifted=False,
        contact=None,
        activity="contact",
        moved=moved,
    )


def lost(blackboard: Blackboard) -> SymbolicState:
    """Symbolic state after an object slipped out of the fingers.

    The best guess is its place in the scene, as most objects slip near their support.
    """
    state, name = state_after_release(blackboard), blackboard.state.holding
    moved = {other: pose for other, pose in state.moved.items() if other != name}
    return replace(state, moved=moved)
