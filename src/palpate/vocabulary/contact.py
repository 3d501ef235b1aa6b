"""The guarded motion: the arm moves until it touches something."""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator
from dataclasses import replace
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from palpate.geometry.pose import Array, Pose
from palpate.robots.robot import Robot, RobotState
from palpate.robots.safety import Expectation
from palpate.scene.raised import is_open
from palpate.trace.samples import STANDARD_GRAVITY
from palpate.vocabulary.admissible.clearance import Motion
from palpate.vocabulary.admissible.probe import starts, touch, untouchable
from palpate.vocabulary.admissible.profile import POSE_ERROR
from palpate.vocabulary.admissible.support import above
from palpate.vocabulary.admissible.unknown_heights import is_unmeasured
from palpate.vocabulary.base import (
    Blackboard,
    LeafFailure,
    Primitive,
    Resource,
    Steps,
    Surroundings,
)
from palpate.vocabulary.state import SymbolicState
from palpate.vocabulary.touch import BRIEF, Feeling, FreeAir, feel, finish, guarded, settle
from palpate.vocabulary.violation import PRECONDITION, Violation

PROBE_SPEED = 0.012
"""m/s where contact is expected: a rigid surface is met with less than 45 N (mean over 10 ms), also
where the arm is heaviest."""
APPROACH_SPEED = 0.020
"""m/s while contact is not expected yet, but may come. Less than twice the speed of the contact, by
which the loading curve is read."""
EXPECTED_WITHIN = 0.03
"""m above the known top in which contact is expected; above one of unknown height it is everywhere."""
CONTACT_FORCE = 8.0
"""N: the threshold tau_c of the paper, against the force felt in free air on the way."""
FIRM_FORCE = 30.0
"""N: the threshold where the hand leans over as it touches: one finger alone may stand on something, or
the arm may only be out of level by so little that the other one follows."""
EASED = 10.0
"""N from which on it presses lightly again: no more than a hand that stands on something may feel, and no
less than is certainly there, as what the joints' friction makes of a force turns round with the arm."""
REPEATABLE = 0.5
"""N by which what is held on something must be less than a hand that stands on something may feel: three
times a force's repeatability. What is hard below something soft is met with more than the threshold."""
RELIEF = 4.0
"""N by which the arm's springs let go of more than that at least."""
EASINGS = math.ceil(FIRM_FORCE / RELIEF)
"""times after which nothing of `FIRM_FORCE` is left on those springs, whatever is felt."""
EASING_SPEED = 0.006
"""m/s: half as fast as it came, so that the arm's dampers do not lift it off as it sets out."""
ASKEW = 3e-4
"""rad that the hand leans over then: a third of what `CONTACT_FORCE` on one finger does."""
SOFT_DEPTH = 5e-4
"""m that the hand goes on from half of `CONTACT_FORCE` to all of it on what gives way, 8 kN/m or less:
the fingers sink in by what they are out of level, and nothing is gained by pressing."""
SIDE_FORCE = 2.0
"""N: the threshold where something that stands freely may be met sideways: the least that is told
from the joints' friction for certain."""
CONTACT_TORQUE = 3.0
"""N m, likewise."""
PROBE_TRAVEL = 0.30
"""m."""

LIGHTEST = 50.0
"""kg/m^3 of an object's box, the least plausible for what nobody weighed: a thin plastic bottle."""
SLIPPERIEST = 0.2
"""friction between an object and its support, the least plausible."""

AXES: dict[str, tuple[float, float, float]] = {
    "+x": (1, 0, 0),
    "-x": (-1, 0, 0),
    "+y": (0, 1, 0),
    "-y": (0, -1, 0),
    "+z": (0, 0, 1),
    "-z": (0, 0, -1),
}


class MoveUntilContact(Primitive):
    """Move slowly and compliantly along one axis of the world, with empty fingers, until something
    rigid is touched; the arm then stays in contact. A soft cover is pressed through to what is rigid
    beneath.

    Probe a surface's height with `-z` from its approach pose: a picture is never trusted for heights."""

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
        if problem:
            return [Violation(PRECONDITION, problem)]
        return list(untouchable(state, self.direction, PROBE_TRAVEL))

    @property
    def direction(self) -> Array:
        """(3,) unit vector, world axes."""
        return np.array(AXES[self.axis], dtype=float)

    def _problem(self, state: SymbolicState) -> str | None:
        if state.pose_world_tcp is None or state.is_bent:
            return f"the gripper is not at a known pose; {starts(state)}"
        if state.contact:
            away = (
                f"{state.contact}_{'approach' if state.contact in state.scene.surfaces else 'top'}"
            )
            return f"already in contact with '{state.contact}'; MovePose to '{away}' first"
        if self.axis == "-z" and state.surface_below(state.pose_world_tcp) is None:
            return f"nothing is below '{state.at}'; {starts(state)}"
        if state.holding:
            return (
                f"'{state.holding}' is in the gripper, and the fingertips probe; put it down first: "
                f"MovePose '{above(state, state.grasp)}', MovePose '{state.grasp}', OpenGripper, "
                f"MovePose '{above(state, state.grasp)}', MovePose '{state.at}'"
            )
        for name in self._beside(state):
            bears = withstands(state, name, float(state.pose_world_tcp.position[2]))
            if bears < SIDE_FORCE:
                return (
                    f"'{name}' may tip or slide at {bears:.1f} N, before a touch is felt for certain "
                    f"({SIDE_FORCE:g} N); probe it from above with -z, or grasp it to learn where it is"
                )
        return None

    def _beside(self, state: SymbolicState) -> list[str]:
        """Objects that a sideways probe may meet."""
        start = state.pose_world_tcp
        if start is None or self.axis in ("+z", "-z"):
            return []
        end = start.translated(PROBE_TRAVEL * self.direction)
        return Motion(state, start, end).hits(margin=POSE_ERROR)

    def during(self, state: SymbolicState) -> SymbolicState:
        return replace(state, activity="moving")

    def effects(self, state: SymbolicState) -> SymbolicState:
        first = touch(state, self.direction, PROBE_TRAVEL)
        if first is None:
            return replace(state, contact=None, activity="contact")
        name = first.hit.other.owner
        known = name if self.axis == "-z" and name in state.scene.bodies else None
        return replace(
            state, pose_world_tcp=first.pose, joints=None, contact=known, activity="contact"
        )

    def observed(self, after: SymbolicState, robot: RobotState) -> SymbolicState:
        # What was touched is where it was felt, not where it was believed to be.
        there = replace(after, pose_world_tcp=robot.pose_world_tcp)
        if after.contact is None or not is_open(after.scene, after.contact):
            return there
        return there.raised(after.contact, _reached(after, robot))

    def expectation(self, state: SymbolicState) -> Expectation:
        return Expectation(contact=True, holding=state.holding is not None)

    def run(self, blackboard: Blackboard) -> Steps:
        robot, state = blackboard.robot, blackboard.state
        direction = self.direction
        start, upright = robot.state.pose_world_tcp, _leaning(robot.state)
        threshold = SIDE_FORCE if self._beside(state) else CONTACT_FORCE
        contact = _Contact(robot, direction)
        robot.set_reflex(robot.limits.reflexes.probing)
        for speed, travel in self._stages(state, float(start.position[2])):
            robot.move_axis(direction, speed, travel)
            if (yield from guarded(blackboard, lambda: contact.exceeds(threshold))):
                travelled = robot.state.pose_world_tcp.distance_to(start)
                firm = self.axis == "-z" and contact.depth() < SOFT_DEPTH
                yield from settle(blackboard)
                if firm and abs(_leaning(robot.state) - upright) > ASKEW:
                    yield from self._press(blackboard, contact)
                elif _presses(robot.state.contact) > robot.limits.free_force - REPEATABLE:
                    yield from self._ease(blackboard, contact)
                return f"contact after {1e3 * travelled:.0f} mm"
        raise LeafFailure(
            f"nothing touched within {PROBE_TRAVEL:.2f} m along {self.axis}; "
            "start nearer, or probe another direction"
        )

    def _press(self, blackboard: Blackboard, contact: _Contact) -> Generator[None, None, None]:
        """Firmly, to see whether the other finger comes to stand, and lightly again."""
        robot, direction = blackboard.robot, self.direction
        robot.move_axis(direction, PROBE_SPEED, PROBE_TRAVEL)
        yield from guarded(blackboard, lambda: contact.exceeds(FIRM_FORCE))
        yield from settle(blackboard, BRIEF)
        yield from self._ease(blackboard, contact)

    def _ease(self, blackboard: Blackboard, contact: _Contact) -> Generator[None, None, None]:
        """Until it presses lightly."""
        robot = blackboard.robot
        for _ in range(EASINGS):
            felt = contact.at_rest((yield from feel(blackboard)))
            if felt < EASED:
                break
            relief = max(felt - EASED, RELIEF) / blackboard.scene.arm.stiffness.translation
            robot.move_axis(-self.direction, EASING_SPEED, relief)
            yield from finish(blackboard)
            yield from settle(blackboard, BRIEF)
        yield from settle(blackboard)

    def _stages(self, state: SymbolicState, z: float) -> list[tuple[float, float]]:
        """Speed, m/s, and travel, m, of one part of the way after the other."""
        below = state.surface_below(state.pose_world_tcp) if state.pose_world_tcp else None
        if self.axis != "-z" or below is None:
            return [(PROBE_SPEED, PROBE_TRAVEL)]
        far = z - state.scene.arm.tip - state.top_of(below) - EXPECTED_WITHIN
        if far < EXPECTED_WITHIN or is_unmeasured(state, below.name):
            return [(PROBE_SPEED, PROBE_TRAVEL)]
        return [(APPROACH_SPEED, far), (PROBE_SPEED, PROBE_TRAVEL - far)]


def _reached(state: SymbolicState, robot: RobotState) -> float:
    """World z, m, of the top under the fingertips."""
    return float(robot.pose_world_tcp.position[2]) - state.scene.arm.tip


def withstands(state: SymbolicState, name: str, z: float) -> float:
    """N that object `name` bears sideways at height `z` (world, m) for certain, before it tips over
    an edge of its footprint or slides.

    Of its mass, where nobody knows it, the least plausible: m g min(mu, b / h) with half the width
    b of the footprint and the height h of the touch above it.
    """
    body, pose = state.scene.body(name), state.pose_of(name)
    mass = body.known.get("mass", (LIGHTEST * float(np.prod(body.size)),))[0]
    half = float(body.size.min()) / 2
    height = max(min(z, body.top_z(pose)) - body.bottom_z(pose), 1e-3)
    return mass * STANDARD_GRAVITY * min(SLIPPERIEST, half / height)


class _Contact:
    """Contact detection along the direction of a probe; to be asked once a tick."""

    def __init__(self, robot: Robot, direction: Array) -> None:
        self._robot, self._direction = robot, direction
        self._feeling, self._free_air = Feeling(robot), FreeAir(robot, direction)
        self._met: Pose | None = None

    def at_rest(self, wrench: Array) -> float:
        """N that press back on an arm at rest, of a wrench (6,), against what it felt at rest first."""
        return float((wrench - self._feeling.first)[:3] @ self._direction)

    def exceeds(self, threshold: float) -> bool:
        """True if more than `threshold` N press back, or something twists the hand."""
        wrench = self._feeling.now()
        if np.isnan(wrench).any():
            return False
        self._free_air.follow(wrench)
        met = wrench - self._free_air.wrench
        along, turning = float(met[:3] @ self._direction), met[3:]
        if along < CONTACT_FORCE / 2:
            self._met = None  # the joints' friction on the way
        elif self._met is None:
            self._met = self._robot.state.pose_world_tcp
        return along > threshold or float(np.linalg.norm(turning)) > CONTACT_TORQUE

    def depth(self) -> float:
        """m that the hand has gone on since half of `CONTACT_FORCE` pressed back."""
        here = self._robot.state.pose_world_tcp
        return 0.0 if self._met is None else here.distance_to(self._met)


def _presses(wrench: Array) -> float:
    """N of a wrench (6,)."""
    return float(np.linalg.norm(wrench[:3]))


def _leaning(state: RobotState) -> float:
    """rad by which the hand leans over in the closing direction, against its command."""
    return float(state.pose_world_tcp.rotation[2, 1] - state.target_world_tcp.rotation[2, 1])
