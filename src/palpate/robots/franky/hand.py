"""The Franka Hand: commands that block for seconds, and a state that comes in packets, in threads of
their own."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from palpate.robots.sheet import ParallelHand

NOTHING = 0.002
"""m: an opening below this is an empty hand."""
MARGIN = 0.002
"""m: fingers this near to fully open are open."""
PAUSE = 0.01
"""s between two questions to the hand, whose packets come at some 20 Hz or more."""

MISSED = 3
"""Times that it says nothing for a second, libfranka's time-out, after which it is taken for gone."""


@dataclass(frozen=True, slots=True)
class Fingers:
    """State of the hand: m between the fingers, whether it holds something, and when that was heard
    (`time.perf_counter`)."""

    width: float
    grasped: bool
    heard: float


class Hand:
    """Hand that runs one command at a time and keeps the latest state; only the constructor blocks.

    A grasp that is under way is never stopped: the hand would let go of what it holds.

    Attributes:
        problem: what the hand said against the last command, or that it does not answer any more;
            None while all is well.
    """

    def __init__(self, gripper: Any, sheet: ParallelHand) -> None:
        self._gripper, self._sheet = gripper, sheet
        self.problem: str | None = None
        self._lost: str | None = None
        self._fingers = self._ask()
        self._wanted: Callable[[], bool] | None = None
        self._wake = threading.Condition()
        self._busy = self._ended = False
        self._closed = self._fingers.grasped
        for work, name in ((self._command, "palpate hand"), (self._listen, "palpate fingers")):
            threading.Thread(target=work, name=name, daemon=True).start()

    @property
    def fingers(self) -> Fingers:
        """The latest state."""
        return self._fingers

    @property
    def speed(self) -> float:
        """m/s of a finger at most."""
        return self._sheet.speed

    @property
    def lost(self) -> str | None:
        """Reason that the hand stopped answering, None while it answers."""
        return self._lost

    @property
    def moving(self) -> bool:
        """A command is under way."""
        return self._busy

    @property
    def gripping(self) -> bool:
        """It closed, and holds something that is wider than nothing."""
        fingers = self._fingers
        return self._closed and not self._busy and fingers.grasped and fingers.width > NOTHING

    def open(self) -> None:
        """Start opening fully."""
        speed = self._sheet.speed
        self._closed = False
        self._start(lambda: self._gripper.open(speed))

    def close(self, force: float | None) -> None:
        """Start closing with `force` N, all there is by default, until something resists. Whatever the
        width is that it ends at, the hand takes it for a grasp: a miss would let go."""
        speed, most = self._sheet.speed, self._sheet.opening
        with_force = self._sheet.force if force is None else min(force, self._sheet.force)
        self._closed = True
        self._start(lambda: self._gripper.grasp(0.0, speed, with_force, most, most + MARGIN))

    def end(self) -> None:
        """No more commands; what is held stays held."""
        with self._wake:
            self._ended = True
            self._wake.notify_all()

    def _start(self, command: Callable[[], bool]) -> None:
        with self._wake:
            self.problem = None
            self._wanted, self._busy = command, True
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
            self._settle()

    def _settle(self) -> None:
        """Wait for a state that was heard after the command had ended."""
        done = time.perf_counter()
        while self._fingers.heard < done and self._lost is None and not self._ended:
            time.sleep(PAUSE)
        with self._wake:
            self._busy = self._wanted is not None

    def _listen(self) -> None:
        missed = 0
        while not self._ended:
            try:
                self._fingers, missed = self._ask(), 0
            except Exception as error:
                missed += 1
                if missed == MISSED:
                    self._lost = f"the hand does not answer any more: {error}"
                    return
            time.sleep(PAUSE)

    def _ask(self) -> Fingers:
        state = self._gripper.state
        return Fingers(state.width, state.is_grasped, time.perf_counter())
