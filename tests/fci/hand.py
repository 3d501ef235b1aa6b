"""The Franka Hand without its network: what it does with commands, and what its states say."""

from __future__ import annotations

import numpy as np

from .plant import Fingers
from .wire import GRASP, GRIPPER_STATE, WIDTH, GripperCommand, GripperStatus, Request

STOOD = 0.1
"""s: fingers that stood so long have stopped."""
NEAR = 0.002
"""m: a width counts as reached."""
SLOW = 0.02
"""m/s of homing."""
TEMPERATURE = 31
"""degrees Celsius."""
Answer = tuple[Request, bytes]


class FrankaHand:
    """Homing, moves and grasps, one at a time.

    Attributes:
        refuses: every command fails. homed: the opening is known.
    """

    def __init__(self, fingers: Fingers, homed: bool = True) -> None:
        self._fingers, self.homed, self.refuses = fingers, homed, False
        self._doing: Request | None = None
        self._closing = False
        self._grasped: tuple[float, float] | None = None
        self._answers: list[Answer] = []

    @property
    def is_grasped(self) -> bool:
        """Something is held that is as wide as was said."""
        if self._grasped is None or self._doing is not None:
            return False
        least, most = self._grasped
        return least < self._fingers.width < most

    def answers(self) -> list[Answer]:
        """What is to be answered now, each only once."""
        out, self._answers = self._answers, []
        return out

    def state(self, message_id: int) -> bytes:
        """What is sent."""
        opening = self._fingers.opening if self.homed else 0.0
        return GRIPPER_STATE.pack(
            message_id & 0xFFFFFFFF, self._fingers.width, opening, self.is_grasped, TEMPERATURE
        )

    def request(self, asked: Request) -> None:
        """Begin what a client asks over TCP; what was under way is aborted."""
        command = GripperCommand(asked.command)
        if self._doing is not None:
            self._answer(self._doing, GripperStatus.ABORTED)
            self._doing = None
        if command is GripperCommand.STOP:
            self._grasped = None
            self._fingers.let_go()
            self._answer(asked, GripperStatus.SUCCESS)
            return
        if self.refuses:
            self._answer(asked, GripperStatus.FAIL)
            return
        self._doing, self._grasped = asked, None
        if command is GripperCommand.HOMING:
            self._closing = True
            self._fingers.go(None, SLOW)
        elif command is GripperCommand.MOVE:
            width, speed = WIDTH.unpack(asked.payload)
            self._fingers.go(width, speed)
        else:
            _, _, _, speed, force = GRASP.unpack(asked.payload)
            self._fingers.go(None, speed, force)

    def update(self) -> None:
        """After a cycle of the world."""
        self._fingers.observe()
        if self._doing is None or self._fingers.still < STOOD:
            return
        command, width = self._doing.command, self._fingers.width
        if command == GripperCommand.HOMING and self._closing:
            self._closing = False
            self._fingers.go(self._fingers.opening, SLOW)
        elif command == GripperCommand.HOMING:
            self.homed = bool(np.isclose(width, self._fingers.opening, atol=NEAR))
            self._finish(self.homed)
        elif command == GripperCommand.MOVE:
            asked, _ = WIDTH.unpack(self._doing.payload)
            self._finish(abs(width - min(asked, self._fingers.opening)) < NEAR)
        else:
            self._close_grasp(width)

    def _close_grasp(self, width: float) -> None:
        assert self._doing is not None
        asked, inner, outer, _, _ = GRASP.unpack(self._doing.payload)
        if asked - inner < width < asked + outer:
            self._grasped = asked - inner, asked + outer
            self._finish(True)
        else:
            self._fingers.let_go()
            self._finish(False)

    def _finish(self, well: bool) -> None:
        assert self._doing is not None
        self._answer(self._doing, GripperStatus.SUCCESS if well else GripperStatus.UNSUCCESSFUL)
        self._doing = None

    def _answer(self, asked: Request, status: GripperStatus) -> None:
        self._answers.append((asked, int(status).to_bytes(2, "little")))
