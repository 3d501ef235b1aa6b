"""Contact during a straight motion: guarded spans, lowering onto a support, sliding along it."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from functools import partial

import numpy as np

from palpate.geometry.pose import Array, Pose
from palpate.robots.accuracy import mistaken_force
from palpate.robots.reflex import Reflex, Reflexes
from palpate.vocabulary.admissible.grasp import most_sideways
from palpate.vocabulary.admissible.profile import GUARDED_SPEED, POSE_ERROR, Span, leaves, speed
from palpate.vocabulary.base import Blackboard, LeafFailure, Wait
from palpate.vocabulary.load import BREAKAWAY, ROUGHEST, UNFELT, Load
from palpate.vocabulary.touch import (
    BRIEF,
    MET,
    WrenchFilter,
    finish,
    guarded,
    in_words,
    median_wrench,
    settle,
)

SET_DOWN = 10.0
"""N that a held object presses on its support, besides its weight, when it counts as set down."""
DOWN = np.array([0.0, 0.0, -1.0])  # World axes
LOWERINGS = 3  # Largest number of times that an object without full support is lowered further
WAVERS = 0.4  # N by which the sensed force of an arm at rest fluctuates
CREEPS = 1.0
"""N by which that force changes within 0.1 s while the posture of an arm, folded near its base, creeps on
after a motion."""
CREEPINGS = 5  # Largest number of times that its end is waited for
PRESSES = 1.0  # N above the least measurable force, at first: enough must remain once the arm rests
PEAK = 1.4
"""Largest normal force on a slide over the pressing force: the arm presses while it sets out and changes
its speed (21.3 N for 15 N, simulated FR3, friction 1)."""
CONTACT_SPEED = 0.02  # m/s, wherever contact is present or possible
FIRMLY = 0.8
"""Part of the force that would turn an object between the pads that a slide may take: pads creep."""
LIGHTLY = 3.0  # N, least pressing force, lest a slide lifts the dragged object
PRESSED = (
    (0.0, LIGHTLY, CONTACT_SPEED),
    (0.5, 15.0, CONTACT_SPEED),
    (1.0, LIGHTLY, 2.0 * CONTACT_SPEED),
)
"""Parts of a slide: its end as a share, the pressing force, N, and the largest speed, m/s. The normal
force is resolved by the torque sensors, and rises and falls, so that the arm's own friction, or a pull
along the way like a spring's, is not taken for friction; the two speeds likewise for viscous friction."""


def span_reflex(of: Reflexes, span: Span, holding: str | None, sets_down: bool) -> Reflex:
    """Thresholds of the arm's reflex on a span. A held object may press as it is lifted or set
    down."""
    if span.guarded and (sets_down or leaves(span.start, span.end)):
        return replace(of.probing, load=of.carrying.load)
    return of.carrying if holding else of.free


def follow_free(blackboard: Blackboard, span: Span, left: float) -> Wait:
    """Wait until a motion under way has passed a span with nothing near."""
    fastest = blackboard.scene.arm.pace.speed
    yield
    while not _passed(blackboard, span, left):
        yield _soonest(blackboard, span, left, fastest)


def follow_guarded(
    blackboard: Blackboard, span: Span, left: float, sets_down: bool, goal: str
) -> Generator[float | None, None, bool]:
    """Wait until a motion under way has passed a guarded span, which `left` m follow: True when the
    held object is set down on its support, which ends the motion.

    Raises:
        LeafFailure: any other contact; the arm still presses on it.
    """
    robot, filtered, scene = blackboard.robot, WrenchFilter(blackboard.robot), blackboard.scene
    # Joints that turn round on the way, in a lift or as the elbow sways, rub the other way: that is no contact.
    least = max(MET, mistaken_force(scene.arm, robot.state.q))
    fastest = speed(span, scene)
    yield
    while not _passed(blackboard, span, left):
        wrench = filtered.now()
        change = wrench - filtered.first
        # Friction of the joints may keep newtons in either reference; what presses shows in both.
        if sets_down and min(-blackboard.load.borne(wrench), -change[2]) > SET_DOWN:
            robot.hold()
            return True
        met = change[:3] - _explained(blackboard, change, sets_down, span)
        if np.linalg.norm(met) > least:
            before = 1e3 * (left + robot.state.pose_world_tcp.distance_to(span.end))
            raise LeafFailure(
                f"unexpected contact: the hand pushes with {in_words(met)} on something "
                f"{before:.0f} mm before the end of the way to '{goal}'"
            )
        yield None if np.isnan(wrench).any() else _soonest(blackboard, span, left, fastest)
    return False


def _passed(blackboard: Blackboard, span: Span, left: float) -> bool:
    """True if a motion has passed a span, or has ended."""
    state = blackboard.robot.state
    return not state.moving or (left > 0.0 and _ahead(blackboard, span) <= 0.0)


def _soonest(blackboard: Blackboard, span: Span, left: float, fastest: float) -> float:
    """s after which a motion of at most `fastest` m/s may have passed a span, at the earliest; the end of a motion is
    noticed anyway."""
    return _ahead(blackboard, span) / fastest if left > 0.0 else np.inf


def _ahead(blackboard: Blackboard, span: Span) -> float:
    """m of a span that a motion has not passed."""
    gone = blackboard.robot.state.target_world_tcp.distance_to(span.start)
    return span.start.distance_to(span.end) - gone


def _explained(blackboard: Blackboard, change: Array, sets_down: bool, span: Span) -> Array:
    """(3,) N, part of a change of the wrench (6,) that belongs to the motion."""
    lift = float(change[2])
    if sets_down:
        # An object that has turned in the pads presses with one end first, and rubs there.
        pressed = max(-lift, 0.0)
        sideways = float(np.linalg.norm(change[:2]))
        rubs = min(1.0, ROUGHEST * pressed / max(sideways, 1e-9))
        return np.array([*(rubs * change[:2]), -pressed])
    if not leaves(span.start, span.end):
        return np.zeros(3)
    if blackboard.state.holding is None:
        return change[:3]  # the hand pressed on what it leaves
    heaviest = blackboard.robot.limits.payload * blackboard.robot.gravity
    return np.array([0.0, 0.0, min(max(lift, 0.0), heaviest)])


def lower(blackboard: Blackboard, goal: str) -> Wait:
    """Lower a held object until its support bears it: the arm sags, and fingers that press slip. The
    arm's last sag before it rests may relieve the support again, or the friction of a folded arm's
    joints seem to: so repeat, each time with twice the press. That is a contact which is meant to be: friction of
    joints that turn round beside it may look like more than carrying explains."""
    before = blackboard.state
    for lowering in range(LOWERINGS):
        yield from _rest(blackboard)
        if blackboard.load.too_much((yield from median_wrench(blackboard)), WAVERS) is None:
            return
        pressed = PRESSES * 2**lowering
        borne = partial(_is_borne, blackboard.load, WrenchFilter(blackboard.robot), pressed)
        blackboard.robot.move_axis(DOWN, GUARDED_SPEED, POSE_ERROR)
        blackboard.state = replace(before, lifted=False)
        try:
            stands = yield from guarded(blackboard, borne)
        finally:  # a stop that comes meanwhile has to lower it
            blackboard.state = before
        if not stands:
            raise LeafFailure(
                f"nothing bears '{blackboard.state.holding}' at '{goal}' or "
                f"{1e3 * POSE_ERROR:.0f} mm below: it stays in the fingers"
            )


def _rest(blackboard: Blackboard) -> Wait:
    """Wait until the arm is at rest, and so is the force on it."""
    for _ in range(CREEPINGS):
        forces: list[float] = []
        for _ in settle(blackboard):
            forces.append(float(blackboard.robot.state.contact[2]))
            yield
        third = max(len(forces) // 3, 1)
        earlier, later = np.median(forces[-2 * third : -third]), np.median(forces[-third:])
        if abs(later - earlier) < CREEPS:
            return


def _is_borne(load: Load, filtered: WrenchFilter, pressed: float) -> bool:
    """True if a support bears the whole load. A light load is `pressed` on it, N, as its weight alone
    would not be measurable."""
    wrench = filtered.now()
    if not load.borne(wrench) < 0.0:
        return False
    return load.hanging is None or load.relieved(wrench) > UNFELT + pressed


def slide(blackboard: Blackboard, target: Pose, most: float) -> Wait:
    """Drag the held object along its support to a pose at `most` m/s, pressed lightly, firmly, and
    lightly again."""
    robot = blackboard.robot
    start, weight = robot.state.target_world_tcp, _weight(blackboard)
    # More force than the roughest support resists with is a collision.
    normal = PEAK * max(force for _, force, _ in PRESSED) + weight
    sideways = BREAKAWAY * ROUGHEST * normal + MET
    blackboard.set_reflex(replace(robot.limits.reflexes.contact, sideways=sideways))
    way = target.position - start.position
    safe = max(CONTACT_SPEED, speed(Span(start, target, True), blackboard.scene))
    fastest = min(safe, most)
    for share, force, pace in PRESSED:
        # Dragged harder, the object would turn between the pads: then press less, down to taking
        # half of its weight off its support.
        load = blackboard.load
        bearable = FIRMLY * most_sideways(blackboard.state, way) / load.rough
        pressed = min(force, max(bearable - weight, -0.5 * load.weight))
        down = pressed / blackboard.scene.arm.stiffness.translation
        here = Pose(start.position + share * way - [0.0, 0.0, down], target.quaternion)
        robot.move_pose(here, min(pace, fastest))
        wrench = yield from drag(blackboard)
        if share > 0.0:
            blackboard.load = blackboard.load.dragged(wrench)
        yield from settle(blackboard, BRIEF)
    robot.move_pose(target, min(CONTACT_SPEED, fastest))
    yield from finish(blackboard)
    yield from settle(blackboard)


def drag(blackboard: Blackboard) -> Generator[float | None, None, Array]:
    """Wait until the commanded motion has ended; (6,) the wrench right before."""
    filtered = WrenchFilter(blackboard.robot)
    yield
    wrench = filtered.now()
    while blackboard.robot.state.moving:
        yield
        wrench = filtered.now()
    return wrench


def _weight(blackboard: Blackboard) -> float:
    """Weight of the held object, N: measured or known, else the largest that the arm carries."""
    robot, state = blackboard.robot, blackboard.state
    if blackboard.load.weight > 0.0:
        return blackboard.load.weight
    assert state.holding is not None
    known = state.scene.body(state.holding).known.get("mass", (robot.limits.payload,))
    return known[0] * robot.gravity
