"""The guarded motion: the arm moves until it touches something."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from palpate.geometry.pose import Array
from palpate.robots.safety import Expectation
from palpate.vocabulary.base import Blackboard, Primitive, Resource, Steps, Surroundings
from palpate.vocabulary.motion import guard, settle
from palpate.vocabulary.state import SymbolicState
from palpate.vocabulary.violation import PRECONDITION, Violation

PROBE_SPEED = 0.015
"""m/s, guarded motions: slow enough that one tick of 20 ms adds less than 1 N on a rigid
surface."""
CONTACT_FORCE = 8.0
"""N: the threshold tau_c of the paper, against the force felt in free air at the start of the
motion."""
CONTACT_TORQUE = 3.0
"""N m, likewise."""
PROBE_TRAVEL = 0.30
"""m."""

AXES: dict[str, tuple[float, float, float]] = {
    "+x": (1, 0, 0),
    "-x": (-1, 0, 0),
    "+y": (0, 1, 0),
    "-y": (0, -1, 0),
    "+z": (0, 0, 1),
    "-z": (0, 0, -1),
}


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

    @classmethod
    def groundings(cls, around: Surroundings) -> Iterator[MoveUntilContact]:
        # Only what lies below is known to be touched.
        yield cls(axis="-z")

    def requires(self, state: SymbolicState) -> list[Violation]:
        problem = self._problem(state)
        return [Violation(PRECONDITION, problem)] if problem else []

    def _problem(self, state: SymbolicState) -> str | None:
        if state.pose_world_tcp is None:
            return "the gripper is not at a known pose; MovePose to an approach pose first"
        if state.contact:
            return f"already in contact with '{state.contact}'; MovePose away first"
        if self.axis == "-z" and state.surface_below(state.pose_world_tcp) is None:
            return f"nothing is below '{state.at}'; go to the approach pose of the surface to probe"
        if state.holding:
            return f"'{state.holding}' is in the gripper; put it down before probing with the fingertips"
        return None

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
