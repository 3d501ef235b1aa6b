"""Checks of an arm before it is commanded."""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate.errors import InputError, Unavailable
from palpate.geometry.pose import Pose
from palpate.robots.franky.hand import NOTHING, Hand
from palpate.robots.franky.readout import pose_of
from palpate.robots.nominal import NominalArm

MATCH, TURNED = 0.002, np.radians(0.5)
"""m, rad between the TCP of the description and that of the control box."""


def require_free(hand: Hand) -> None:
    """Require an empty hand.

    Raises:
        Unavailable: it holds something.
    """
    fingers = hand.fingers
    if fingers.grasped and fingers.width > NOTHING:
        hand.end()
        raise Unavailable(
            f"the hand holds something at {1e3 * fingers.width:.0f} mm: take it out (Desk opens the "
            "fingers), then run again"
        )


def require_end_effector(state: Any, nominal: NominalArm, pose_world_base: Pose) -> float:
    """Require the control box's TCP to agree with the description's; return their distance, m.

    Raises:
        InputError: it does not.
    """
    row = nominal.poses(np.array(state.q)[None])[0]
    mine, theirs = Pose(row[:3], row[3:]), pose_world_base @ pose_of(state.O_T_EE)
    away, turned = mine.distance_to(theirs), mine.angle_to(theirs)
    if away > MATCH or turned > TURNED:
        raise InputError(
            f"the end effector that Desk is set to has its TCP {1e3 * away:.1f} mm and "
            f"{np.degrees(turned):.1f}° from where the arm's description has it: set the Franka Hand as "
            "end effector in Desk, or describe the one that is there (docs/arms.md)"
        )
    return away
