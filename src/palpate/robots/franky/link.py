"""Data received from the arm each cycle: its time, its samples, and the reason of a stop."""

from __future__ import annotations

import time
from contextlib import suppress

import numpy as np

from palpate.geometry.pose import Array
from palpate.robots.franky import faults
from palpate.robots.franky.control.drive import Drive, Reacted, Row
from palpate.robots.franky.hand import Hand
from palpate.robots.franky.library import Call
from palpate.robots.franky.readout import PERIOD, Readout
from palpate.robots.franky.session import Session
from palpate.trace.samples import Samples

SHORTEST, SLICE = 0.001, 0.005
"""s of wall time that are waited for the next cycles at a time."""
OWN_STALL = 0.7
"""s of silence that do not count on a computer without a realtime kernel, or on loopback."""
SILENT = 0.08
"""s of silence beyond that after which the control box is taken for gone: sooner than what it said
last is too old to act upon."""
GAP = 0.03
"""s without a sample."""
ANSWERS = 0.1
"""s in which a control box that ended a motion says in which mode it is."""
LOST = "look at the network cable and at Desk"


class Link:
    """Listens to an arm and its hand, and never waits for one that says nothing: robot time goes on
    with the clock on the wall then.

    Attributes:
        t: s, robot time now.
        mode: the control box's.
        width: m between the fingers.
        fault: why the arm does not go on; None while it does.
        reflex: why it stopped itself since that was last forgotten.
        lost: the control box does not answer any more.
    """

    def __init__(
        self, session: Session, readout: Readout, drive: Drive, hand: Hand, turn: Array
    ) -> None:
        """`turn` (3, 3): the base's axes in the world's."""
        self._session, self._readout, self._drive, self._hand = session, readout, drive, hand
        self._turn = turn
        self.mode = faults.mode_of(readout.state)
        self.fault: str | None = None
        self.reflex: str | None = None
        self.lost = False
        self.t = self._due = self._sampled = self._t_width = readout.stamp
        self.width = hand.fingers.width
        self._silence = 0.0
        self._slack = 0.0 if session.address.realtime else OWN_STALL
        self._logged: list[Samples] = []

    def advance(self, duration: float) -> None:
        """Let so many s of robot time pass."""
        self._due = max(self._due, self.t) + duration
        self._pass_until(self._due)
        if self.fault is None and self.t - self._sampled > GAP:
            # The control loop has just begun: its first cycles make no sample yet.
            self._pass_until(self.t + 2 * PERIOD)

    def drain(self) -> Samples:
        """The samples since the last call."""
        logged, self._logged = self._logged, []
        return logged[0] if len(logged) == 1 else Samples.concatenate(logged)

    def fail(self, why: str) -> None:
        """The arm does not go on; what the fingers hold, they hold."""
        if self.fault is None:
            self.fault = why

    def failed(self, error: Exception) -> None:
        """It does not go on for what franky raised."""
        self.fail(faults.of_error(error, self.mode))

    def taken_up(self) -> None:
        """A person saw to it: the arm goes on."""
        self._drive.ended()
        self.fault = self.reflex = self._hand.problem = None
        self._silence = 0.0

    def _pass_until(self, t: float) -> None:
        while self.t < t:
            self._listen()
        self._take()

    def _listen(self) -> None:
        """Wait for the next cycle, or a while. A silence counts as long as this computer listened."""
        began, heard = time.perf_counter(), self._stamp()
        if self.fault is not None:
            time.sleep(SLICE)
        elif self._drive.begun:
            self._hear_loop()
        else:
            self._ask()
        waited = min(time.perf_counter() - began, 2 * SLICE)
        self._silence = 0.0 if self._stamp() > heard else self._silence + waited
        self.t = max(self.t, self._stamp() + max(self._silence - self._slack, 0.0))
        if self.fault is not None:
            self.t += waited
        elif self._silence > self._slack + SILENT:
            self.lost = True
            self.fail(f"the control box has said nothing for {self._silence:.1f} s: {LOST}")

    def _hear_loop(self) -> None:
        # Woken at every cycle, this thread would keep the one that leads the arm from it.
        time.sleep(min(max(0.5 * (self._due - self.t), SHORTEST), SLICE))
        if not self._session.robot.is_in_control:
            self._loop_ended()

    def _loop_ended(self) -> None:
        """The arm stopped itself, or somebody did."""
        try:
            self._session.robot.join_motion(SLICE)
        except Exception as error:
            self.lost = faults.is_network(error)
            if not self.lost:
                self._ask_mode()
            self.failed(error)
        self._drive.ended()

    def _ask_mode(self) -> None:
        with suppress(Exception):
            state = Call(lambda: self._session.robot.state, "palpate mode").result(ANSWERS)
            self.mode = faults.mode_of(state)

    def _ask(self) -> None:
        """The state of an arm that no loop controls."""
        try:
            state = self._session.robot.state
        except Exception as error:
            self.failed(error)
            return
        if state.time.to_sec() > self._stamp():
            self._idle(Row(state, self._readout.pose_world_tcp.vector, False))
        if reason := faults.of_mode(state):
            self.mode = faults.mode_of(state)
            self.fail(reason)

    def _idle(self, row: Row) -> None:
        with self._drive.lock:
            self._drive.log.append(row)
        self._keep(self._readout.read([row], self.width))

    def _keep(self, samples: Samples) -> None:
        self._logged.append(samples)
        if len(samples):
            self._sampled = float(samples.t[-1])

    def _stamp(self) -> float:
        """s, robot time of the newest cycle."""
        return max(self._readout.stamp, self._drive.last)

    def _take(self) -> None:
        """Take over the cycles since the last advance."""
        self._follow_width()
        rows = self._drive.take()
        if rows:
            self._keep(self._readout.read(rows, self.width))
            if self.fault is None:
                self.mode = faults.mode_of(rows[-1].state)
        if self._drive.reacted is not None and self.reflex is None:
            self.reflex = self._why(self._drive.reacted)
        if problem := self._hand.lost or self._hand.problem:
            self.fail(problem)

    def _why(self, how: Reacted) -> str:
        felt = np.array(how.state.O_F_ext_hat_K)
        contact = np.concatenate([self._turn @ felt[:3], self._turn @ felt[3:]])
        size = float(np.linalg.norm(contact[:3]))
        return how.thresholds.fired(contact) or (
            f"unexpected contact: the arm stopped itself at {size:.1f} N"
        )

    def _follow_width(self) -> None:
        """The hand speaks more seldom than the arm: between two words its fingers go no faster than
        they can."""
        told, passed = self._hand.fingers.width, self._due - self._t_width
        most = 2 * self._hand.speed * passed
        self.width += float(np.clip(told - self.width, -most, most))
        self._t_width = self._due
