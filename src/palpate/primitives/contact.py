"""Guarded motion: the arm moves until it makes contact."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import takewhile
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from palpate.common.pose import Array, Pose, digits
from palpate.primitives.base import (
    ARM,
    Blackboard,
    LeafFailure,
    Primitive,
    Steps,
    Surroundings,
    Wait,
)
from palpate.primitives.guarding import (
    BRIEF,
    FreeAir,
    WrenchFilter,
    finish,
    median_wrench,
    never,
    settle,
    wait_for_contact,
)
from palpate.primitives.rules.clearance import box_hits, hand_path
from palpate.primitives.rules.collision_geometry import hand_sweep, opening
from palpate.primitives.rules.profile import POSE_ERROR
from palpate.primitives.rules.solids import SIDES, solids
from palpate.primitives.rules.support import above, sideways_resistance
from palpate.primitives.rules.sweep import FINEST, Hit
from palpate.primitives.rules.unknown_heights import lacks_measurement
from palpate.primitives.state import PRECONDITION, SymbolicState, Violation
from palpate.robots.robot import Robot, RobotState
from palpate.robots.safety import Expectation
from palpate.scene.load import is_open

# m/s where contact is expected. The force on a rigid surface stays below 45 N (mean over 10 ms),
# also where the arm's effective mass is largest.
PROBE_SPEED = 0.012
# m/s where contact is possible but not expected yet. It is less than twice the speed of the
# contact, by which the loading curve is fitted.
APPROACH_SPEED = 0.020
# m above a known top in which contact is expected; with an unknown height it is expected
# everywhere.
EXPECTED_WITHIN = 0.03
# N, threshold tau_c of the paper, relative to the force of the motion in free air
CONTACT_FORCE = 8.0
# N, threshold of a firm press. It is used on a soft body, and if the hand tilts at contact. Then
# one finger alone may be supported, or the arm is slightly out of level and the other finger
# follows.
FIRM_FORCE = 30.0
# N to which the pressing force is reduced again. It is below the limit of a hand in contact. It is
# above the error by joint friction, which reverses with the arm.
EASED = 10.0
# N, margin to the limit of a hand in contact: three times the repeatability of a force. A rigid
# body below a soft layer is met with more than the threshold.
REPEATABLE = 0.5
RELIEF = 4.0  # N, least unloading of the arm's springs in one easing step
# Number of easing steps after which the springs are free of `FIRM_FORCE`.
EASINGS = math.ceil(FIRM_FORCE / RELIEF)
# m/s, half of the probing speed, so that the arm's dampers do not lift it off at the start.
EASING_SPEED = 0.006
ASKEW = 3e-4  # rad, tilt at contact: a third of the effect of `CONTACT_FORCE` on one finger
# m, least travel between half of `CONTACT_FORCE` and all of it on a soft body (8 kN/m or less). A
# rigid body below it stops the tips within this travel for the whole force: 60 µm/N, tips included.
SOFT_DEPTH = 5e-4
# m/s, speed of pressing into a soft body, from rest. With an arm stiffness of 3000 N/m, the force
# on a rigid body grows by 18 N/s. `CONTACT_FORCE` then takes 90 samples.
PRESS_SPEED = 0.006
# m, largest thickness of a cover that is pressed through. The tips go no deeper into a soft body,
# unless `CONTACT_FORCE` alone presses them.
THICKEST = 0.03
# N, least threshold where a free object may be met sideways. The force of an arm with calibrated joints varies less
# in free air.
SIDE_FORCE = 2.0
# Ratio of that threshold to the largest force that the arm itself shows on the way in free air. In 13 probes at
# `measured` the force in the next seconds was at most 1.6 times that of the first 0.3 to 1 s.
VARIES = 2.0
# Least ratio of an object's resistance to that force: a box that resists with 2.0 N moves by 0.5 mm,
# and one with 1.5 N is pushed all the way.
RESISTS = 1.25
CONTACT_TORQUE = 3.0  # N m, threshold of the moment: the least that exceeds joint friction
PROBE_TRAVEL = 0.30  # m, largest travel of a probe
# m, search distance for the exact contact, from the believed end of a probe just before it.
SEARCHED = 3.0 * FINEST
TOUCHES = 0.0003  # m, largest distance of two parts in contact
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

    Probe a surface's height with `-z` from its approach pose, then rise straight up to there: a picture
    does not show a height, and a cloth hides it."""

    claims: ClassVar = ARM
    group: ClassVar = "motion"
    timeout: ClassVar[float] = 60.0

    axis: Annotated[
        Literal["+x", "-x", "+y", "-y", "+z", "-z"],
        Field(description="direction of motion, world axes"),
    ]

    @classmethod
    def groundings(cls, around: Surroundings) -> Iterator[MoveUntilContact]:
        # Only the body below is certain to be touched.
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
            pose = "approach" if state.contact in state.scene.surfaces else "top"
            return (
                f"already in contact with '{state.contact}'; "
                f"MovePose to '{state.contact}_{pose}' first"
            )
        if self.axis == "-z" and state.surface_below(state.pose_world_tcp) is None:
            return f"no surface or object is below '{state.at}'; {starts(state)}"
        if state.holding:
            return (
                f"'{state.holding}' is in the gripper, but empty fingertips probe; put it down first: "
                f"MovePose '{above(state, state.grasp)}', MovePose '{state.grasp}', OpenGripper, "
                f"MovePose '{above(state, state.grasp)}', MovePose '{state.at}'"
            )
        return None

    def _objects_ahead(self, state: SymbolicState) -> list[str]:
        """Objects that a sideways probe may meet."""
        start = state.pose_world_tcp
        if start is None or self.axis in ("+z", "-z"):
            return []
        end = start.translate(PROBE_TRAVEL * self.direction)
        return box_hits(state, start, end, margin=POSE_ERROR)

    def during(self, state: SymbolicState) -> SymbolicState:
        return replace(state, activity="moving")

    def effects(self, state: SymbolicState) -> SymbolicState:
        first = touch(state, self.direction, PROBE_TRAVEL)
        if first is None:
            return replace(state, contact=None, activity="contact")
        hit, pose = first
        name = hit.other.owner
        known = name if self.axis == "-z" and name in state.scene.bodies else None
        return replace(state, pose_world_tcp=pose, joints=None, contact=known, activity="contact")

    def observed(self, after: SymbolicState, robot: RobotState) -> SymbolicState:
        # The contact is at the measured pose of the arm, not at the believed one.
        there = replace(after, pose_world_tcp=robot.pose_world_tcp)
        if after.contact is None or not is_open(after.scene, after.contact):
            return self._correct_belief(after, there)
        top = float(robot.pose_world_tcp.position[2]) - after.scene.arm.tip
        return there.raised(after.contact, top)

    def _correct_belief(self, believed: SymbolicState, there: SymbolicState) -> SymbolicState:
        """State `there`, with the pose of the touched body corrected by the contact."""
        # A body of uncertain size is left unchanged: its faces are measured to find the size.
        first = touch(believed, self.direction, SEARCHED)
        body = None if first is None else there.scene.bodies.get(first[0].other.owner)
        if first is None or body is None or body.seen or "size" in body.missing:
            return there
        hit, _ = first
        # Distance along the probe between the measured and the believed contact.
        left = hit.share * SEARCHED + hit.distance
        apart = float(self.direction @ (there.tcp.position - believed.tcp.position)) - left
        return there.touched(body.name, "probe", self.direction, np.array(hit.where), apart)

    def expectation(self, state: SymbolicState) -> Expectation:
        return Expectation(contact=True, holding=state.holding is not None)

    def run(self, blackboard: Blackboard) -> Steps:
        robot, state = blackboard.robot, blackboard.state
        start, upright = robot.state.pose_world_tcp, _tilt(robot.state)
        # A light threshold where a free object may be pushed sideways.
        ahead = self._objects_ahead(state)
        contact = _Contact(robot, self.direction, self._free_travel(state) if ahead else 0.0)
        far = never if ahead else contact.far

        def threshold() -> float:
            force = contact.light_threshold() if ahead else CONTACT_FORCE
            if SIDE_FORCE < force < CONTACT_FORCE:
                _require_resistance(state, ahead, force)
            return force

        blackboard.set_reflex(robot.limits.reflexes.probing)
        for speed, travel in self._stages(state, float(start.position[2])):
            robot.move_axis(self.direction, speed, travel)
            if (yield from wait_for_contact(blackboard, lambda: contact.exceeds(threshold()), far)):
                travelled = robot.state.pose_world_tcp.distance_to(start)
                # A soft cover hides the height of a surface: press through it.
                soft = contact.depth() >= SOFT_DEPTH
                if soft and self._is_open(state):
                    yield from self._press_through(blackboard, contact)
                yield from settle(blackboard)
                firm = self.axis == "-z" and not soft
                if firm and abs(_tilt(robot.state) - upright) > ASKEW:
                    # Press firmly, until the other finger is in contact too, and lightly again.
                    robot.move_axis(self.direction, PROBE_SPEED, PROBE_TRAVEL)
                    yield from wait_for_contact(blackboard, lambda: contact.exceeds(FIRM_FORCE))
                    yield from settle(blackboard, BRIEF)
                    yield from self._ease(blackboard, contact)
                # A hand in contact must stay clear of the limit of an unexpected force.
                elif np.linalg.norm(robot.state.contact[:3]) > robot.limits.free_force - REPEATABLE:
                    yield from self._ease(blackboard, contact)
                return f"contact after {1e3 * travelled:.0f} mm"
        raise LeafFailure(
            f"no contact within {PROBE_TRAVEL:.2f} m along {self.axis}; "
            "start nearer, or probe another direction"
        )

    def _free_travel(self, state: SymbolicState) -> float:
        """Length, m, of the way along which no body is believed, errors of the poses included."""
        first = touch(state, self.direction, PROBE_TRAVEL)
        if first is None or state.pose_world_tcp is None:
            return 0.0
        hit, pose = first
        body = state.scene.bodies.get(hit.other.owner)
        doubt = max(POSE_ERROR, body.doubt if body is not None else 0.0)
        return state.pose_world_tcp.distance_to(pose) - doubt

    def _press_through(self, blackboard: Blackboard, contact: _Contact) -> Wait:
        """Press slowly until a rigid body stops the tips, or they are as deep as the thickest cover."""
        # With a linear spring, half of the force is reached at half of the depth.
        left = THICKEST - 2.0 * contact.depth()
        yield from finish(blackboard)
        yield from settle(blackboard, BRIEF)
        contact.course.clear()
        blackboard.robot.move_axis(self.direction, PRESS_SPEED, PROBE_TRAVEL)
        yield from wait_for_contact(
            blackboard, lambda: contact.exceeds(FIRM_FORCE) or contact.is_stopped(left)
        )

    def _ease(self, blackboard: Blackboard, contact: _Contact) -> Wait:
        """Retreat in steps until the hand presses with less than `EASED`."""
        robot = blackboard.robot
        for easing in range(EASINGS):
            force = contact.at_rest((yield from median_wrench(blackboard)))
            if force < EASED:
                break
            # A soft body follows the tips, and unloads the arm's springs by less than the retreat.
            # So double the retreat each time.
            excess = 2.0**easing * (force - EASED)
            relief = max(excess, RELIEF) / blackboard.scene.arm.stiffness.translation
            robot.move_axis(-self.direction, EASING_SPEED, relief)
            yield from finish(blackboard)
            yield from settle(blackboard, BRIEF)
        yield from settle(blackboard)

    def _is_open(self, state: SymbolicState) -> bool:
        """True if the probe is for a surface whose height the scene does not state."""
        below = state.surface_below(state.pose_world_tcp)
        return self.axis == "-z" and below is not None and is_open(state.scene, below.name)

    def _stages(self, state: SymbolicState, z: float) -> list[tuple[float, float]]:
        """Return speed, m/s, and travel, m, of the parts of the motion; it is faster far above a known height."""
        below = state.surface_below(state.pose_world_tcp)
        if self.axis != "-z" or below is None:
            return [(PROBE_SPEED, PROBE_TRAVEL)]
        far = z - state.scene.arm.tip - state.top_of(below) - EXPECTED_WITHIN
        if far < EXPECTED_WITHIN or lacks_measurement(state, below.name):
            return [(PROBE_SPEED, PROBE_TRAVEL)]
        return [(APPROACH_SPEED, far), (PROBE_SPEED, PROBE_TRAVEL - far)]


def starts(state: SymbolicState) -> str:
    """Remedy: start the probe above the surface below, or above any surface."""
    below = None if state.pose_world_tcp is None else state.surface_below(state.pose_world_tcp)
    names = [below.name] if below is not None and below.role == "surface" else state.scene.surfaces
    places = [f"'{name}_approach'" for name in names]
    if not places:
        return "go lower"
    return f"a surface is probed with -z from just above: MovePose to {' or '.join(places)} first"


def touch(state: SymbolicState, direction: Array, travel: float) -> tuple[Hit, Pose] | None:
    """First believed contact of the hand within `travel` m along a direction (3,).

    The pose of the TCP (world) is just before the contact. None without contact, or from an unknown
    pose.
    """
    start = state.pose_world_tcp
    if start is None:
        return None

    def compute() -> tuple[Hit, Pose] | None:
        end = start.translate(travel * direction)
        # Sweep the hand along the probe and take the first pair within contact distance.
        path = hand_path(solids(state.scene), start, end, opening(state), FINEST)
        swept = hand_sweep(state, path, TOUCHES)
        first = swept.first(np.full(len(swept.pairs), TOUCHES))
        if first is None:
            return None
        clear = max(first.share * travel - FINEST, 0.0)
        return first, start.translate(clear * direction)

    key = ("touch", *state.arrangement, digits(direction), travel)
    return solids(state.scene).get_or_compute(key, compute)


def untouchable(state: SymbolicState, direction: Array, travel: float) -> Iterator[Violation]:
    """Violation of a guarded motion: no contact, or an inadmissible one."""
    first = touch(state, direction, travel)
    if first is None:
        yield Violation(
            PRECONDITION, f"there is no body within {travel:.2f} m of '{state.at}'; {starts(state)}"
        )
        return
    hit, _ = first
    name = hit.other.owner
    if hit.part.kind not in SIDES:
        yield Violation(
            "collision",
            f"the {hit.part.owner} would touch '{name}' before the fingertips; probe from a pose above "
            "the middle of the body, clear of all others",
        )
    if name in state.scene.objects and abs(float(direction[2])) < 0.5:
        # The rehearsal draws unknown masses; what rolls is pushed at any mass.
        resists = sideways_resistance(state, name)
        is_known = "mass" in state.scene.body(name).known
        if resists == 0.0 or (is_known and resists < RESISTS * SIDE_FORCE):
            yield Violation(
                PRECONDITION,
                f"the probe would push '{name}' away: it presses with {SIDE_FORCE:g} N until it stops, and '{name}' "
                f"resists with {resists:.1f} N; touch it from above, or grasp it",
            )


def _require_resistance(state: SymbolicState, objects: list[str], force: float) -> None:
    """Require that objects resist a sideways `force`, N, the least that is no error of the arm; else LeafFailure."""
    for name in objects:
        resists = sideways_resistance(state, name)
        if resists < RESISTS * force:
            raise LeafFailure(
                f"the arm's own force varies so much in free air that a contact shows from {force:.1f} N on, and "
                f"'{name}' resists with {resists:.1f} N: the probe would push it away; touch it from above, or grasp it"
            )


class _Contact:
    """Contact detection along the direction of a probe; evaluated once a tick.

    No body is believed along the first `free` m of the way.
    """

    def __init__(self, robot: Robot, direction: Array, free: float = 0.0) -> None:
        self._robot, self._direction = robot, direction
        self._start, self._free, self._varies = robot.state.pose_world_tcp, free, 0.0
        self._filtered, self._free_air = WrenchFilter(robot), FreeAir(robot, direction)
        self._met: Pose | None = None
        self.course: list[tuple[float, Pose]] = []  # reaction force, N, and pose at every tick

    def at_rest(self, wrench: Array) -> float:
        """Reaction force on an arm at rest, N, by a wrench (6,) against the first one at rest."""
        return float((wrench - self._filtered.first)[:3] @ self._direction)

    def exceeds(self, threshold: float) -> bool:
        """True if the reaction force exceeds `threshold`, N, or a torque its own threshold."""
        wrench = self._filtered.now()
        if np.isnan(wrench).any():
            return False
        self._free_air.follow(wrench)
        # Reaction force and moment: difference from the baseline in free air.
        met = wrench - self._free_air.wrench
        along, turning = float(met[:3] @ self._direction), met[3:]
        self.course.append((along, self._robot.state.pose_world_tcp))
        if self._free_air.known and self._is_in_free_air():
            self._varies = max(self._varies, along)
        if along < CONTACT_FORCE / 2:
            self._met = None  # joint friction during the motion
        elif self._met is None:
            self._met = self._robot.state.pose_world_tcp
        return along > threshold or float(np.linalg.norm(turning)) > CONTACT_TORQUE

    def light_threshold(self) -> float:
        """Threshold, N, for a free object: more than the force of the arm itself varied in free air."""
        if self._is_in_free_air():
            return CONTACT_FORCE
        return min(max(SIDE_FORCE, VARIES * self._varies), CONTACT_FORCE)

    def _is_in_free_air(self) -> bool:
        """True on the part of the way along which no body is believed."""
        return self._robot.state.pose_world_tcp.distance_to(self._start) < self._free

    def far(self) -> bool:
        """True without any reaction force, after the start phase of the motion."""
        return self._met is None and self._free_air.known

    def is_stopped(self, left: float) -> bool:
        """True if a rigid body stops the tips, or the travel exceeds `left`, m.

        A rigid body makes the force grow by `CONTACT_FORCE` over the last `SOFT_DEPTH` of travel.
        """
        if not self.course:
            return False
        force, here = self.course[-1]
        near = takewhile(lambda at: here.distance_to(at[1]) <= SOFT_DEPTH, reversed(self.course))
        rise = force - min(earlier for earlier, _ in near)
        return rise > CONTACT_FORCE or here.distance_to(self.course[0][1]) > left

    def depth(self) -> float:
        """Travel, m, since the reaction force exceeded half of `CONTACT_FORCE`."""
        here = self._robot.state.pose_world_tcp
        return 0.0 if self._met is None else here.distance_to(self._met)


def _tilt(state: RobotState) -> float:
    """Tilt of the hand in the closing direction against its command, rad."""
    return float(state.pose_world_tcp.rotation[2, 1] - state.target_world_tcp.rotation[2, 1])
