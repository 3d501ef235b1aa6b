"""End of a motion: believed state, and arrival of the arm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from palpate.geometry.pose import Pose
from palpate.vocabulary.admissible.support import clear_of_support
from palpate.vocabulary.base import Blackboard, LeafFailure
from palpate.vocabulary.state import SymbolicState

POSITION_TOLERANCE = 0.010
"""m: an impedance-controlled arm with 1.5 kg on it sags by several millimetres. Where it sags by more,
as soft springs do, what hangs on it explains that."""
ANGLE_TOLERANCE = np.radians(3.0)
"""rad: likewise."""
UNDER_WAY = 90.0
"""s that one motion may take: half a metre at the least speed of a cautious arm."""


def at_rest(state: SymbolicState, at: str | None, target: Pose) -> SymbolicState:
    """The state at rest with the TCP at a pose, and with it what is held."""
    there = replace(
        state, at=at, pose_world_tcp=target, joints=None, contact=None, activity="still"
    )
    if state.holding is None or state.pose_tcp_object is None:
        return there
    pose_world_object = target @ state.pose_tcp_object
    lifted = clear_of_support(state, state.holding, pose_world_object)
    return replace(
        there,
        lifted=lifted,
        activity="still" if lifted else "contact",
        moved={**state.moved, state.holding: pose_world_object},
    )


def arrived(blackboard: Blackboard, target: Pose, goal: str) -> str:
    """Distance of the arm from its target, in words; `goal` is the plan's name of it.

    Raises:
        LeafFailure: too far.
    """
    measured = blackboard.robot.state.pose_world_tcp
    distance, angle = measured.distance_to(target), measured.angle_to(target)
    if distance > POSITION_TOLERANCE:
        distance = measured.distance_to(_sagged(blackboard, target))
    if distance > POSITION_TOLERANCE or angle > ANGLE_TOLERANCE:
        raise LeafFailure(
            f"stopped {1e3 * distance:.1f} mm and {np.degrees(angle):.1f}° from '{goal}', "
            f"more than {1e3 * POSITION_TOLERANCE:.0f} mm or {np.degrees(ANGLE_TOLERANCE):.0f}°: "
            "something is in the way, or the pose is at the edge of the arm's reach"
        )
    return f"within {1e3 * distance:.1f} mm"


def _sagged(blackboard: Blackboard, target: Pose) -> Pose:
    """Sag of the soft springs under the load."""
    sag = blackboard.load.weight / blackboard.scene.arm.stiffness.translation
    return target.translated((0.0, 0.0, -sag)) if blackboard.state.holding else target
