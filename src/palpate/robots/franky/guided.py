"""An arm that somebody leads by hand: read, never commanded."""

from __future__ import annotations

from palpate.errors import Unavailable
from palpate.geometry.pose import Pose
from palpate.robots.franky import faults
from palpate.robots.franky.library import Call
from palpate.robots.franky.readout import pose_of
from palpate.robots.franky.session import Session

ANSWERS = 2.0
"""s within which arm and hand say where they are."""


class Guided:
    """Implements `palpate.cells.teach.GuidedHand`."""

    def __init__(self, session: Session, pose_world_base: Pose) -> None:
        self._session, self._base = session, pose_world_base

    def where(self) -> tuple[Pose, float]:
        """See `GuidedHand`."""
        session = self._session
        try:
            state = Call(lambda: session.robot.state, "palpate state").result(ANSWERS)
            fingers = Call(lambda: session.gripper.state, "palpate fingers").result(ANSWERS)
        except Exception as error:
            raise Unavailable(f"{session.address}: {faults.of_error(error)}") from error
        return self._base @ pose_of(state.O_T_EE), float(fingers.width)

    def close(self) -> None:
        """See `GuidedHand`."""
        self._session.close()
