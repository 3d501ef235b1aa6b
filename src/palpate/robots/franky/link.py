"""Data received from the arm in each cycle, and the Franka Hand in its own threads."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.common.errors import Unavailable
from palpate.common.pose import Array
from palpate.common.processes import Call
from palpate.robots.franky import control_box
from palpate.robots.franky.drive import CycleRow, Drive
from palpate.robots.franky.session import PERIOD, FrankySession, StateReadout
from palpate.robots.sheet import EMPTY, ParallelHand
from palpate.trace.samples import Samples

MARGIN = 0.002  # m: fingers this close to fully open count as open
PAUSE = 0.01  # s between two queries of the hand, which sends about 20 or more packets a second
MISSED = 3  # unanswered queries, each of libfranka's time-out, 1 s, after which it is lost


@dataclass(frozen=True, slots=True)
class Fingers:
    """State of the hand."""

    width: float  # m between the fingers
    grasped: bool
    heard: float  # `time.perf_counter` of its arrival


class HandThread:
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
        """Test if the hand closed and holds an object."""
        fingers = self.fingers
        return self._closed and not self.moving and fingers.grasped and fingers.width > EMPTY

    def require_free(self) -> None:
        """Require an empty hand. Raises Unavailable: it holds an object."""
        fingers = self.fingers
        if fingers.grasped and fingers.width > EMPTY:
            self.end()
            raise Unavailable(
                f"the hand holds something at {1e3 * fingers.width:.0f} mm: take it out (Desk opens "
                "the fingers), then run again"
            )

    def open(self, width: float | None = None) -> None:
        """Start opening to `width` m, or fully."""
        self._closed = False
        if width is None or width >= self._sheet.opening:
            self._start(lambda: self._gripper.open(self.speed))
        else:
            self._start(lambda: self._gripper.move(width, self.speed))

    def close(self, force: float | None) -> None:
        """Start closing with `force` N, by default the full force, until an object resists.

        The hand accepts any final width as a grasp: after a miss it would open again.
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


# Data received from the arm in each cycle: its time, its samples, and the reason of a stop.


SHORTEST, SLICE = 0.001, 0.005  # s of wall time to wait for the next cycles
OWN_STALL = 0.7  # s of silence allowed for a computer without a realtime kernel, or on loopback
# s: silence beyond `OWN_STALL` after which the control box counts as lost. At that time, the last
# data can still be acted on.
SILENT = 0.08
GAP = 0.03  # s without a sample
MODE_WAIT = 0.1  # s in which a control box that ended a motion reports its mode


class StateListener:
    """Listens to an arm and its hand, and never blocks on a silent one.

    During silence, robot time follows the wall clock.

    Attributes:
        t: s, robot time now.
        mode: mode of the control box.
        width: m between the fingers.
        fault: reason that the arm stopped for good; None while it works.
        reflex: reason of its last reflex, until it is cleared.
        lost: True if the control box does not answer any more.
    """

    def __init__(
        self,
        session: FrankySession,
        readout: StateReadout,
        drive: Drive,
        hand: HandThread,
        turn: Array,
    ) -> None:
        """Start at the readout's time; `turn` (3, 3) rotates from the base's axes into the world's."""
        self._session, self._readout, self._drive, self._hand = session, readout, drive, hand
        self._turn = turn
        self.mode = control_box.mode_of(readout.state)
        self.fault: str | None = None
        self.reflex: str | None = None
        self.lost = False
        self.t = self._due = self._sampled = self._t_width = readout.stamp
        self.width = hand.fingers.width
        self._silence = 0.0
        self._slack = 0.0 if session.address.realtime else OWN_STALL
        self._logged: list[Samples] = []

    def advance(self, duration: float) -> None:
        """Let `duration` s of robot time pass."""
        self._due = max(self._due, self.t) + duration
        self._pass_until(self._due)
        if self.fault is None and self.t - self._sampled > GAP:
            # The control loop has just begun: its first cycles make no sample yet.
            self._pass_until(self.t + 2 * PERIOD)

    def drain(self) -> Samples:
        """Return the samples since the last call."""
        logged, self._logged = self._logged, []
        return logged[0] if len(logged) == 1 else Samples.concatenate(logged)

    def fail(self, why: str | Exception) -> None:
        """Stop for good, for a reason or an exception of franky; the first one is kept. A held object stays
        held.
        """
        if self.fault is None:
            self.fault = why if isinstance(why, str) else control_box.of_error(why, self.mode)

    def taken_up(self) -> None:
        """Continue after a person's recovery."""
        self._drive.note_end()
        self.fault = self.reflex = self._hand.problem = None
        self.lost, self._silence = False, 0.0

    def _pass_until(self, t: float) -> None:
        while self.t < t:
            self._listen()
        self._take()

    def _listen(self) -> None:
        """Wait for the next cycle, at most one slice. Only silence during which this computer listens
        counts.
        """
        began, heard = time.perf_counter(), self._stamp()
        if self.fault is not None:
            time.sleep(SLICE)
        elif self._drive.begun:
            # Woken at every cycle, this thread would delay the thread that leads the arm.
            time.sleep(min(max(0.5 * (self._due - self.t), SHORTEST), SLICE))
            if not self._session.robot.is_in_control:
                self._end_loop()
        else:
            self._ask()
        # Without new data, robot time follows the wall clock, and silence adds up until the box counts as
        # lost.
        waited = min(time.perf_counter() - began, 2 * SLICE)
        self._silence = 0.0 if self._stamp() > heard else self._silence + waited
        self.t = max(self.t, self._stamp() + max(self._silence - self._slack, 0.0))
        if self.fault is not None:
            self.t += waited
        elif self._silence > self._slack + SILENT:
            self.lost = True
            self.fail(
                f"the control box has said nothing for {self._silence:.1f} s: look at the network "
                "cable and at Desk"
            )

    def _end_loop(self) -> None:
        """Determine the reason for the end of the control loop: a reflex, a person or an error."""
        try:
            self._session.robot.join_motion(SLICE)
        except Exception as error:
            self.lost = control_box.is_network(error)
            if not self.lost:
                with suppress(Exception):
                    state = Call(lambda: self._session.robot.state, "palpate mode").result(
                        MODE_WAIT
                    )
                    self.mode = control_box.mode_of(state)
            self.fail(error)
        self._drive.note_end()

    def _ask(self) -> None:
        """Read the state of an arm that no control loop commands."""
        try:
            state = self._session.robot.state
        except Exception as error:
            self.fail(error)
            return
        if state.time.to_sec() > self._stamp():
            row = CycleRow(state, self._readout.pose_world_tcp.vector)
            with self._drive.lock:
                self._drive.log.append(row)
            self._keep([row])
        if reason := control_box.of_mode(state):
            self.mode = control_box.mode_of(state)
            self.fail(reason)

    def _keep(self, rows: list[CycleRow]) -> None:
        samples = self._readout.read(rows, self.width)
        self._logged.append(samples)
        if len(samples):
            self._sampled = float(samples.t[-1])

    def _stamp(self) -> float:
        """Return the robot time of the newest cycle, s."""
        return max(self._readout.stamp, self._drive.last)

    def _take(self) -> None:
        """Process the cycles since the last advance."""
        # The hand reports less often than the arm. In between, the width changes no faster than the fingers
        # can move.
        most = 2 * self._hand.speed * (self._due - self._t_width)
        self.width += float(np.clip(self._hand.fingers.width - self.width, -most, most))
        self._t_width = self._due
        rows = self._drive.take()
        if rows:
            self._keep(rows)
            if self.fault is None:
                self.mode = control_box.mode_of(rows[-1].state)
        # Turn the wrench of a reflex into world axes, and name its reason once.
        reacted = self._drive.reacted
        if reacted is not None and self.reflex is None:
            base = np.array(reacted.state.O_F_ext_hat_K)
            contact = np.concatenate([self._turn @ base[:3], self._turn @ base[3:]])
            size = float(np.linalg.norm(contact[:3]))
            self.reflex = reacted.thresholds.fired(contact) or (
                f"unexpected contact: the arm stopped itself at {size:.1f} N"
            )
        if problem := self._hand.lost or self._hand.problem:
            self.fail(problem)
