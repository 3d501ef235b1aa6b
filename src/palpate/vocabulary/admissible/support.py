"""What an object in the hand stands on: whether it hangs free, is dragged, or would fall."""

from __future__ import annotations

import math

import numpy as np

from palpate.geometry.pose import Pose
from palpate.vocabulary.state import SymbolicState
from palpate.vocabulary.violation import PRECONDITION, Violation

LIFTED = 0.005
"""m: a held object whose bottom is this far above its support is clear of it."""
MIN_SLIDE = 0.03
"""m: a shorter slide is not much more than the grip's and the arm's compliance."""


def clear_of_support(state: SymbolicState, name: str, pose_world_object: Pose) -> bool:
    """Whether object `name` at that pose hangs free of whatever is below it."""
    body = state.scene.body(name)
    below = state.surface_below(pose_world_object)
    top = below.top_z(state.pose_of(below.name)) if below else -np.inf
    return body.bottom_z(pose_world_object) > top + LIFTED


def slides(before: SymbolicState, after: SymbolicState) -> bool:
    """Whether a motion from one state to the other drags the held object along its support."""
    stands = before.holding is not None and not before.lifted and not after.lifted
    return stands and _travel(before, after) > LIFTED


def short_slide(before: SymbolicState, after: SymbolicState) -> list[Violation]:
    """What speaks against a slide that is to be felt: that it is too short, or nothing."""
    travel = _travel(before, after)
    if not slides(before, after) or travel >= MIN_SLIDE:
        return []
    factor = math.ceil(2 * MIN_SLIDE / max(travel, 1e-3))
    return [
        Violation(
            "short-slide",
            f"'{before.holding}' is slid by only {1e3 * travel:.0f} mm; slide it "
            f"{1e3 * MIN_SLIDE:.0f} mm or more, with a factor of {factor} on the offset",
        )
    ]


def would_fall(state: SymbolicState) -> list[Violation]:
    """What speaks against opening the fingers: that what they hold has no support, or nothing."""
    if not (state.holding and state.lifted):
        return []
    return [
        Violation(
            "gripper-state",
            f"'{state.holding}' is lifted and would fall; MovePose it onto its support first, "
            f"e.g. to '{state.grasp}'",
        )
    ]


def would_be_dragged(state: SymbolicState) -> list[Violation]:
    """What speaks against a joint motion, which is no straight line: a held object on its support,
    or nothing."""
    if not state.holding or state.lifted:
        return []
    return [
        Violation(
            PRECONDITION,
            f"'{state.holding}' stands on its support in the gripper; lift it or open the gripper first",
        )
    ]


def _travel(before: SymbolicState, after: SymbolicState) -> float:
    """Distance between the two TCPs, m; 0 where one is not known."""
    if before.pose_world_tcp is None or after.pose_world_tcp is None:
        return 0.0
    return before.pose_world_tcp.distance_to(after.pose_world_tcp)
