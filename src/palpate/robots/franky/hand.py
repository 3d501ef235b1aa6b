"""The Franka Hand, in threads: its commands block for seconds, and its state comes in packets."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from palpate.errors import Unavailable
from palpate.robots.sheet import ParallelHand

NOTHING = 0.002  # m: an opening below this is an empty hand
MARGIN = 0.002  # m: fingers this near to fully open are open
PAUSE = 0.01  # s between two queries of the hand, whose packets come at some 20 Hz or more
MISSED = 3  # queries without an answer within libfranka's time-out, 1 s, after which it is lost


@dataclass(frozen=True, slots=True)
class Fingers:
    """State of the hand."""

    width: float  # m between the fingers
    grasped: bool
    heard: float  # `time.perf_counter` of its arrival


class Hand:
    """Hand that runs one command at a time and keeps the latest state; only the constructor blocks.

    A grasp in progress is never interrupted: the hand would drop the object.

    Attributes:
        fingers: the latest state.
        speed: m/s of a finger at most.
        moving: True while a command is executed.
        problem: error of the last command; None without one.
        lost: reason that the hand stopped answering; None while it answers.
    """

    def __init__(self, gripper: Any, sheet: ParallelHand) -> None:
        self._gripper, self._sheet, self.speed = gripper, sheet, sheet.speed
        self.problem: str | None = None
        self.lost: str | None = None
        self.fingers = self._ask()
        self._wanted: Callable[[], bool] | None = None
        self._wake = threading.Condition()
        self.moving = self._ended = False
        self._closed = self.fingers.grasped
        for work, name in ((self._command, "palpate hand"), (self._listen, "palpate fingers")):
            threading.Thread(target=work, name=name, daemon=True).start()

    @property
    def gripping(self) -> bool:
        """True if the hand closed, and holds an object."""
        fingers = self.fingers
        return self._closed and not self.moving and fingers.grasped and fingers.width > NOTHING

    def require_free(self) -> None:
        """Require an empty hand.

        Raises:
            Unavailable: it holds something.
        """
        fingers = self.fingers
        if fingers.grasped and fingers.width > NOTHING:
            self.end()
            raise Unavailable(
                f"the hand holds something at {1e3 * fingers.width:.0f} mm: take it out (Desk opens "
                "the fingers), then run again"
            )

    def open(self) -> None:
        """Start opening fully."""
        self._closed = False
        self._start(lambda: self._gripper.open(self.speed))

    def close(self, force: float | None) -> None:
        """Start closing with `force` N, by default the full force, until something resists.

        The hand takes any final width for a grasp: after a miss it would open again.
        """
        speed, widest = self.speed, self._sheet.opening + MARGIN
        with_force = self._sheet.force if force is None else min(force, self._sheet.force)
        self._closed = True
        self._start(lambda: self._gripper.grasp(0.0, speed, with_force, MARGIN, widest))

    def end(self) -> None:
        """End the threads; a held object stays held."""
        with self._wake:
            self._ended = True
            self._wake.notify_all()

    def _start(self, command: Callable[[], bool]) -> None:
        with self._wake:
            self.problem = None
            self._wanted, self.moving = command, True
            self._wake.notify_all()

    def _command(self) -> None:
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._wanted is not None or self._ended)
                if self._ended:
                    return
                command, self._wanted = self._wanted, None
            assert command is not None
            try:
                if not command() and not self._closed:
                    self.problem = "the hand did not open"
            except Exception as error:
                self.problem = f"the hand does not do what it is told: {error}"
            # The command counts as executed with the first state that arrives after it.
            done = time.perf_counter()
            while self.fingers.heard < done and self.lost is None and not self._ended:
                time.sleep(PAUSE)
            with self._wake:
                self.moving = self._wanted is not None

    def _listen(self) -> None:
        missed = 0
        while not self._ended:
            try:
                self.fingers, missed = self._ask(), 0
            except Exception as error:
                missed += 1
                if missed == MISSED:
                    self.lost = f"the hand does not answer any more: {error}"
                    return
            time.sleep(PAUSE)

    def _ask(self) -> Fingers:
        state = self._gripper.state
        return Fingers(state.width, state.is_grasped, time.perf_counter())
