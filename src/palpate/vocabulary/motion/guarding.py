"""The spans of a straight way: free where nothing is near, felt where something may be met."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace

import numpy as np

from palpate.geometry.pose import Array
from palpate.robots.accuracy import turned_round
from palpate.robots.reflex import Reflex, Reflexes
from palpate.vocabulary.admissible.profile import Span, leaves
from palpate.vocabulary.base import Blackboard, LeafFailure, Steps
from palpate.vocabulary.touch import MET, Feeling, in_words

SET_DOWN = 10.0
"""N that a held object presses on its support, its weight aside, before it counts as set down."""


def feel_on(
    blackboard: Blackboard, span: Span, left: float, sets_down: bool, goal: str
) -> Generator[None, None, bool]:
    """Follow a guarded span of a motion under way, which goes on for `left` m behind it: True when
    the held object's support bears it and more, which ends the motion.

    Raises:
        LeafFailure: it meets something else; the arm still presses on it.
    """
    robot, feeling = blackboard.robot, Feeling(blackboard.robot)
    least = _least(blackboard, span)
    yield
    while not _passed(blackboard, span, left):
        wrench = feeling.now()
        change = wrench - feeling.first
        if sets_down and -blackboard.load.borne(wrench) > SET_DOWN:
            robot.hold()
            return True
        met = change[:3] - _explained(blackboard, change, sets_down, span)
        if np.linalg.norm(met) > least:
            before = 1e3 * (left + robot.state.pose_world_tcp.distance_to(span.end))
            raise LeafFailure(
                f"unexpected contact: the hand pushes with {in_words(met)} on something "
                f"{before:.0f} mm before the end of the way to '{goal}'"
            )
        yield
    return False


def _least(blackboard: Blackboard, span: Span) -> float:
    """N of a change that is something met: more than the joints' friction that turns round in a lift."""
    if blackboard.state.holding is None or not leaves(span.start, span.end):
        return MET
    scene = blackboard.scene
    return max(MET, turned_round(scene.arm, scene.pose_world_base.inverse() @ span.start))


def go_on(blackboard: Blackboard, span: Span, left: float) -> Steps:
    """Follow a span of a motion under way in which nothing is near."""
    yield
    while not _passed(blackboard, span, left):
        yield
    return "passed"


def reflex_on(of: Reflexes, span: Span, holding: str | None, sets_down: bool) -> Reflex:
    """At what the arm stops itself on the way. What it leaves, or sets down, may press."""
    if span.guarded and (sets_down or leaves(span.start, span.end)):
        return replace(of.probing, load=of.carrying.load)
    return of.carrying if holding else of.free


def _passed(blackboard: Blackboard, span: Span, left: float) -> bool:
    """True if a motion has left a span behind, or has ended."""
    state = blackboard.robot.state
    length = span.start.distance_to(span.end)
    gone = state.target_world_tcp.distance_to(span.start)
    return not state.moving or (left > 0.0 and gone >= length)


def _explained(blackboard: Blackboard, change: Array, sets_down: bool, span: Span) -> Array:
    """(3,) N: the part of a change of force (6,) that belongs to the motion."""
    lift = float(change[2])
    if sets_down:
        return np.array([0.0, 0.0, min(lift, 0.0)])
    if not leaves(span.start, span.end):
        return np.zeros(3)
    if blackboard.state.holding is None:
        return change[:3]  # what was pressed on is relieved
    heaviest = blackboard.robot.limits.payload * blackboard.robot.gravity
    return np.array([0.0, 0.0, min(max(lift, 0.0), heaviest)])
