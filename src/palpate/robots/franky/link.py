"""Data received from the arm each cycle: its time, its samples, and the reason of a stop."""

from __future__ import annotations

import time
from contextlib import suppress

import numpy as np

from palpate.geometry.pose import Array
from palpate.robots.franky import faults
from palpate.robots.franky.drive import Drive, Row
from palpate.robots.franky.hand import Hand
from palpate.robots.franky.library import Call
from palpate.robots.franky.readout import PERIOD, Readout
from palpate.robots.franky.session import Session
from palpate.trace.samples import Samples

SHORTEST, SLICE = 0.001, 0.005  # s of wall time to wait for the next cycles
OWN_STALL = 0.7  # s of silence allowed for a computer without a realtime kernel, or on loopback
SILENT = 0.08
"""s of silence beyond that after which the control box is lost: sooner than its last data is too old
to act upon."""
GAP = 0.03  # s without a sample
ANSWERS = 0.1  # s in which a control box that ended a motion reports its mode


class Link:
    """Listens to an arm and its hand, and never blocks on a silent one: robot time then follows the
    clock on the wall.

    Attributes:
        t: s, robot time now.
        mode: the control box's.
        width: m between the fingers.
        fault: reason that the arm stopped for good; None while it goes on.
        reflex: reason of its last reflex, until it is cleared.
        lost: True if the control box does not answer any more.
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
        """Stop for good, for a reason or an exception of franky; the first one is kept. A held
        object stays held."""
        if self.fault is None:
            self.fault = why if isinstance(why, str) else faults.of_error(why, self.mode)

    def taken_up(self) -> None:
        """Go on after a person's recovery."""
        self._drive.ended()
        self.fault = self.reflex = self._hand.problem = None
        self.lost, self._silence = False, 0.0

    def _pass_until(self, t: float) -> None:
        while self.t < t:
            self._listen()
        self._take()

    def _listen(self) -> None:
        """Wait for the next cycle, at most a slice. Silence is counted only while this computer
        listens."""
        began, heard = time.perf_counter(), self._stamp()
        if self.fault is not None:
            time.sleep(SLICE)
        elif self._drive.begun:
            # Woken at every cycle, this thread would delay the one that leads the arm.
            time.sleep(min(max(0.5 * (self._due - self.t), SHORTEST), SLICE))
            if not self._session.robot.is_in_control:
                self._end_loop()
        else:
            self._ask()
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
        """Find out why the control loop ended: by a reflex, a person or an error."""
        try:
            self._session.robot.join_motion(SLICE)
        except Exception as error:
            self.lost = faults.is_network(error)
            if not self.lost:
                with suppress(Exception):
                    state = Call(lambda: self._session.robot.state, "palpate mode").result(ANSWERS)
                    self.mode = faults.mode_of(state)
            self.fail(error)
        self._drive.ended()

    def _ask(self) -> None:
        """Read the state of an arm that no loop controls."""
        try:
            state = self._session.robot.state
        except Exception as error:
            self.fail(error)
            return
        if state.time.to_sec() > self._stamp():
            row = Row(state, self._readout.pose_world_tcp.vector)
            with self._drive.lock:
                self._drive.log.append(row)
            self._keep([row])
        if reason := faults.of_mode(state):
            self.mode = faults.mode_of(state)
            self.fail(reason)

    def _keep(self, rows: list[Row]) -> None:
        samples = self._readout.read(rows, self.width)
        self._logged.append(samples)
        if len(samples):
            self._sampled = float(samples.t[-1])

    def _stamp(self) -> float:
        """Return the robot time of the newest cycle, s."""
        return max(self._readout.stamp, self._drive.last)

    def _take(self) -> None:
        """Process the cycles since the last advance."""
        # The hand reports more seldom than the arm: in between, the width changes no faster than the
        # fingers can move.
        most = 2 * self._hand.speed * (self._due - self._t_width)
        self.width += float(np.clip(self._hand.fingers.width - self.width, -most, most))
        self._t_width = self._due
        rows = self._drive.take()
        if rows:
            self._keep(rows)
            if self.fault is None:
                self.mode = faults.mode_of(rows[-1].state)
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
