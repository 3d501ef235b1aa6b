"""The safety predicate p_safe(s_t) of the paper: pure functions of the cached state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.robots.robot import Limits, RobotState


@dataclass(frozen=True, slots=True)
class Expectation:
    """Which forces belong to what the arm is doing.

    Attributes:
        holding: an object hangs on the hand, so vertical force up to the payload is normal.
        contact: touching something is the purpose, so force up to the limit is normal.
        grasped: the fingers must still be on something; losing it is a slip.
    """

    holding: bool = False
    contact: bool = False
    grasped: bool = False


def violation(state: RobotState, limits: Limits, expected: Expectation) -> str | None:
    """The first violated predicate, worded with its figures; None while the state is safe."""
    raise NotImplementedError
