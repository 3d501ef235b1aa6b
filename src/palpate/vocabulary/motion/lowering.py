"""A held object is lowered on, until its support bears it."""

from __future__ import annotations

import numpy as np

from palpate.geometry.pose import Array
from palpate.vocabulary.admissible.profile import GUARDED_SPEED, POSE_ERROR
from palpate.vocabulary.base import Blackboard, LeafFailure, Steps
from palpate.vocabulary.load import UNFELT, Load
from palpate.vocabulary.touch import Feeling, feel, guarded, settle

DOWN = np.array([0.0, 0.0, -1.0])
"""World axes."""
LOWERINGS = 3
"""Largest number of times that an object without full support is lowered further."""
WAVERS = 0.4
"""N by which what is felt at rest changes from one moment to the next."""
PRESSES = 1.0
"""N besides what is just felt: what is left of it once the arm rests must be felt, too."""


def lower(blackboard: Blackboard, goal: str) -> Steps:
    """On until the support bears what is held: the arm sags, and fingers that press slip. What
    a touch gave it to bear goes again as the arm comes to rest."""
    for _ in range(LOWERINGS):
        yield from settle(blackboard)
        if blackboard.load.too_much((yield from feel(blackboard)), WAVERS) is None:
            return "borne"
        yield from _press(blackboard, goal)
    return "lowered"


def _press(blackboard: Blackboard, goal: str) -> Steps:
    load, robot = blackboard.load, blackboard.robot
    feeling = Feeling(robot)
    robot.move_axis(DOWN, GUARDED_SPEED, POSE_ERROR)
    if not (yield from guarded(blackboard, lambda: _bears(load, feeling.now()))):
        raise LeafFailure(
            f"nothing bears '{blackboard.state.holding}' at '{goal}' or "
            f"{1e3 * POSE_ERROR:.0f} mm below: it stays in the fingers"
        )
    return "pressed"


def _bears(load: Load, wrench: Array) -> bool:
    """True if a support bears the whole load by the measured force; a light load is pressed on it,
    as its weight alone would not be measurable."""
    if not load.borne(wrench) < 0.0:
        return False
    return load.hanging is None or load.relieved(wrench) > UNFELT + PRESSES
