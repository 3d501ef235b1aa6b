"""What happens to a held object when a run stops early: it is put down, or held still, never
dropped."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np

from palpate.robots.safety import Expectation
from palpate.vocabulary.base import Blackboard, Primitive, Resource, Steps
from palpate.vocabulary.gripper import finish_fingers
from palpate.vocabulary.motion import finish, guard
from palpate.vocabulary.state import SymbolicState

DOWN = np.array([0.0, 0.0, -1.0])
LOWERING_SPEED = 0.02
"""m/s."""
AT_GRASP = 0.003
"""m: an object this near to the height where it was grasped still stands on its support."""
EXTRA_TRAVEL = 0.015
"""m below the height where it was grasped: covers the arm's sag and a soft support."""
SUPPORTED = 5.0
"""N that the support must take over before the fingers open."""
RETREAT_SPEED = 0.05
"""m/s."""
RETREAT = 0.10
"""m."""
SETTLING = 0.3
"""s."""


class PutDown(Primitive):
    """Lower the held object until its support takes its weight, open the fingers, retreat upwards.

    Fails, and leaves the object in the closed fingers, when it meets no support down to where it
    was grasped. Not part of the vocabulary: only the runner uses it, on its way to a controlled
    stop.
    """

    claims: ClassVar[frozenset[Resource]] = frozenset({"arm", "gripper"})
    group: ClassVar = "motion"
    timeout: ClassVar[float] = 60.0

    def expectation(self, state: SymbolicState) -> Expectation:
        held = state.holding is not None
        return Expectation(contact=True, grasped=held)

    def run(self, blackboard: Blackboard) -> Steps:
        height = self._height(blackboard)
        if height > AT_GRASP or blackboard.state.lifted:
            yield from self._lower(blackboard, max(height, 0.0) + EXTRA_TRAVEL)
        name = blackboard.state.holding or "the object"
        blackboard.state = released(blackboard)
        blackboard.robot.open_gripper()
        yield from finish_fingers(blackboard)
        blackboard.robot.move_axis(-DOWN, RETREAT_SPEED, RETREAT)
        yield from _arrive(blackboard)
        return f"put {name} down"

    def _height(self, blackboard: Blackboard) -> float:
        """How far above the place of its grasp the object is, m; 0 when it was not lifted since."""
        grasp = blackboard.state.grasp
        if grasp is None:
            return 0.0
        z = blackboard.scene.symbols.resolve(grasp).position[2]
        return float(blackboard.robot.state.pose_world_tcp.position[2] - z)

    def _lower(self, blackboard: Blackboard, travel: float) -> Steps:
        blackboard.robot.move_axis(DOWN, LOWERING_SPEED, travel)
        yield
        free = blackboard.robot.state.wrench[2]
        yield from guard(
            blackboard,
            lambda: bool(free - blackboard.robot.state.wrench[2] >= SUPPORTED),
            f"no support within {1e3 * travel:.0f} mm below '{blackboard.state.holding}': "
            "it stays in the fingers",
        )
        yield from _arrive(blackboard)
        return "supported"


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


def _arrive(blackboard: Blackboard) -> Steps:
    """Wait until the arm's motion has ended and it had time to come to rest."""
    yield from finish(blackboard)
    since = blackboard.robot.state.t
    while blackboard.robot.state.t - since < SETTLING:
        yield
    return "arrived"
