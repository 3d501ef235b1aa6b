"""Sliding of a held object along its support: normal force and speed."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace

from palpate.geometry.pose import Array
from palpate.robots.reflex import Reflex
from palpate.vocabulary.admissible.grasp import most_sideways
from palpate.vocabulary.base import Blackboard
from palpate.vocabulary.load import BREAKAWAY, ROUGHEST
from palpate.vocabulary.touch import MET, Feeling

PEAK = 1.4
"""Largest normal force on a slide over the pressing force: the arm presses while it sets out and changes
its speed (21.3 N for 15 N, simulated FR3, friction 1)."""
CONTACT_SPEED = 0.02
"""m/s, whenever something is or may be touched."""
FIRMLY = 0.8
"""part of what keeps an object from turning between the pads that a slide may take: they creep."""
LIGHTLY = 3.0
"""N that is pressed at least, lest a slide lifts what it drags."""
PRESSED = (
    (0.0, LIGHTLY, CONTACT_SPEED),
    (0.5, 15.0, CONTACT_SPEED),
    (1.0, LIGHTLY, 2.0 * CONTACT_SPEED),
)
"""Part of a slide, how hard it is pressed there, N, and how fast it goes there, m/s, at most: a
normal force that the torque sensors resolve, and that rises and falls again, so that neither what the
arm's own friction adds to the sliding force nor what pulls with the way, like a spring, passes for
friction; and two speeds, so that what grows with the speed does not, either."""


def reflex_sliding(blackboard: Blackboard) -> Reflex:
    """At what the arm stops itself as it drags what it holds: at more than the roughest support
    holds back of what presses on it, it has met something else."""
    contact = blackboard.robot.limits.reflexes.contact
    pressed = PEAK * max(force for _, force, _ in PRESSED) + _weight(blackboard)
    return replace(contact, sideways=BREAKAWAY * ROUGHEST * pressed + MET)


def lowered(blackboard: Blackboard, way: Array, force: float) -> float:
    """m by which the equilibrium is lowered on a slide along `way` (3,): it presses with `force`, N,
    or less where what it then takes to drag the object would turn it between the pads; at most half of
    its weight is taken off its support."""
    load, stiffness = blackboard.load, blackboard.scene.arm.stiffness.translation
    bearable = FIRMLY * most_sideways(blackboard.state, way) / load.rough
    spare = bearable - _weight(blackboard)
    return min(force, max(spare, -0.5 * load.weight)) / stiffness


def drag(blackboard: Blackboard) -> Generator[None, None, Array]:
    """Wait until the arm's commanded motion has ended; (6,) the wrench felt right before."""
    feeling = Feeling(blackboard.robot)
    yield
    wrench = feeling.now()
    while blackboard.robot.state.moving:
        yield
        wrench = feeling.now()
    return wrench


def _weight(blackboard: Blackboard) -> float:
    """N, of what is held: as felt or known, else the most that the arm carries."""
    robot, state = blackboard.robot, blackboard.state
    if blackboard.load.weight > 0.0:
        return blackboard.load.weight
    assert state.holding is not None
    known = state.scene.body(state.holding).known.get("mass", (robot.limits.payload,))
    return known[0] * robot.gravity
