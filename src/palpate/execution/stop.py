"""Controlled stop with a held object: it is put down, or held still, never dropped.

It is put down only where its support is proven: believed to be below with a margin, met at about
that height, and pressed upon by the whole weight and more, at rest and for a while. Anything less,
an edge, a push that comes and goes, leaves it in the closed fingers.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from typing import ClassVar

import numpy as np

from palpate.geometry.pose import Pose
from palpate.robots.safety import Expectation
from palpate.vocabulary.admissible.profile import GUARDED_SPEED, POSE_ERROR
from palpate.vocabulary.admissible.support import footing, stable
from palpate.vocabulary.base import Blackboard, LeafFailure, Primitive, Resource, Steps
from palpate.vocabulary.gripper import finish_fingers
from palpate.vocabulary.guarding import DOWN
from palpate.vocabulary.state import SymbolicState
from palpate.vocabulary.touch import Feeling, finish, guarded, settle

AT_GRASP = 0.003
"""m: an object this near to the height where it was grasped still stands on its support."""
EXTRA_TRAVEL = 0.015
"""m below the believed support: covers the arm's sag, the pose's error and a soft support."""
PRESSED = 5.0
"""N that the object presses on its support, its whole weight aside, before it counts as borne."""
STILL_PRESSED = 2.0
"""N of it that must be left after `PROVEN`."""
PROVEN = 0.5
"""s that it must bear it, at rest."""
PRESSES = 3
"""times that it is pressed upon for that, each by `PRESSED` more: what hung askew between the pads turns as
it comes to lie flat, and gives way meanwhile."""
STAYS = "it stays in the fingers"
RETREAT_SPEED = 0.05
"""m/s."""
RETREAT = 0.10
"""m."""


class PutDown(Primitive):
    """Lower the held object until its support bears its weight, open the fingers, retreat upwards.

    Fails, and leaves the object in the closed fingers, where no support is proven. Not part of the
    vocabulary: only the runner uses it, on its way to a controlled stop.
    """

    claims: ClassVar[frozenset[Resource]] = frozenset({"arm", "gripper"})
    group: ClassVar = "motion"
    timeout: ClassVar[float] = 60.0

    def expectation(self, state: SymbolicState) -> Expectation:
        held = state.holding is not None
        return Expectation(contact=True, grasped=held)

    def slipping(self, blackboard: Blackboard) -> str | None:
        """A slipping object is put down nevertheless, as long as the fingers have it."""
        return None

    def run(self, blackboard: Blackboard) -> Steps:
        robot, name = blackboard.robot, blackboard.state.holding
        robot.set_reflex(robot.limits.reflexes.contact)
        if name is not None:
            yield from self._to_support(blackboard, name)
        blackboard.state = released(blackboard)
        robot.open_gripper()
        yield from finish_fingers(blackboard)
        robot.move_axis(-DOWN, RETREAT_SPEED, RETREAT)
        yield from finish(blackboard)
        yield from settle(blackboard)
        return f"put {name or 'what was just grasped'} down"

    def _to_support(self, blackboard: Blackboard, name: str) -> Steps:
        """Onto a support that bears it; where the object was grasped and never lifted, it is
        there."""
        place = self._place(blackboard, name)
        if reason := stable(blackboard.state, name, place):
            raise LeafFailure(f"'{name}' cannot be put down here, {reason}: {STAYS}")
        if blackboard.state.lifted or self._height(blackboard) > AT_GRASP:
            yield from self._lower(blackboard, name, place)
        return "supported"

    def _place(self, blackboard: Blackboard, name: str) -> Pose:
        """Pose in which the object would stand, straight below where it is held."""
        held = _held(blackboard)
        gap = footing(blackboard.state, name, held).gap
        return held.translated((0.0, 0.0, -gap)) if np.isfinite(gap) else held

    def _height(self, blackboard: Blackboard) -> float:
        """Height of the object above the place of its grasp, m; 0 if it was not lifted since."""
        grasp = blackboard.state.grasp
        if grasp is None:
            return 0.0
        z = blackboard.state.resolve(grasp).position[2]
        return float(blackboard.robot.state.pose_world_tcp.position[2] - z)

    def _lower(self, blackboard: Blackboard, name: str, place: Pose) -> Steps:
        """Down to the support, until it bears the object."""
        robot, feeling, load = blackboard.robot, Feeling(blackboard.robot), blackboard.load
        travel = max(_above(blackboard, place), 0.0) + EXTRA_TRAVEL
        nowhere = f"no support within {1e3 * travel:.0f} mm below '{name}': {STAYS}"
        robot.move_axis(DOWN, GUARDED_SPEED, travel)
        if not (yield from guarded(blackboard, lambda: -load.borne(feeling.now()) > PRESSED)):
            raise LeafFailure(nowhere)
        yield from finish(blackboard)
        yield from settle(blackboard)
        early = _above(blackboard, place)
        if early > POSE_ERROR:
            raise LeafFailure(
                f"'{name}' met something {1e3 * early:.0f} mm above its support: {STAYS}"
            )
        yield from self._prove(blackboard, name)
        return "supported"

    def _prove(self, blackboard: Blackboard, name: str) -> Steps:
        """Stand there for a while, all of which the support must bear the object."""
        robot = blackboard.robot
        for _ in range(PRESSES - 1):
            if (yield from _is_borne(blackboard)):
                return "proven"
            robot.move_axis(
                DOWN, GUARDED_SPEED, PRESSED / blackboard.scene.arm.stiffness.translation
            )
            yield from finish(blackboard)
            yield from settle(blackboard)
        if not (yield from _is_borne(blackboard)):
            raise LeafFailure(f"nothing bears '{name}' for long: {STAYS}")
        return "proven"


def _is_borne(blackboard: Blackboard) -> Generator[None, None, bool]:
    """Wait for `PROVEN` s, or less; whether the support bore the object all that time."""
    robot, feeling = blackboard.robot, Feeling(blackboard.robot)
    start = robot.state.t
    while robot.state.t - start < PROVEN:
        if -blackboard.load.borne(feeling.now()) < STILL_PRESSED:
            return False
        yield
    return True


def _held(blackboard: Blackboard) -> Pose:
    """Pose of the held object by the present pose of the arm."""
    held = blackboard.state.pose_tcp_object
    tcp = blackboard.robot.state.pose_world_tcp
    return tcp if held is None else tcp @ held


def _above(blackboard: Blackboard, place: Pose) -> float:
    """m that the held object is above where it would stand."""
    return float(_held(blackboard).position[2] - place.position[2])


def released(blackboard: Blackboard) -> SymbolicState:
    """The symbolic state once the fingers let go where they are now."""
    state, tcp = blackboard.state, blackboard.robot.state.pose_world_tcp
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
        activity="still",
        moved=moved,
    )


def lost(blackboard: Blackboard) -> SymbolicState:
    """The symbolic state once an object has slipped out of the fingers: the best guess is that it
    never left its place, as fingers that slip mostly do so before the object is far from its
    support."""
    state, name = released(blackboard), blackboard.state.holding
    return replace(
        state, moved={other: pose for other, pose in state.moved.items() if other != name}
    )
