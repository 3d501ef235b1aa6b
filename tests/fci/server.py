"""The sockets and the clock: one robot and one hand, served by one thread.

In lockstep, time waits for the client: a state goes out, and the world does not move on until the
answer to it is there, nor faster than `fastest` times a clock. Where nobody is in command time
passes `pace` times as fast as a clock's, and where nobody is connected it stands still. Free
running, a cycle takes 1 ms whether an answer came or not.
"""

from __future__ import annotations

import math
import select
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .hand import FrankaHand
from .robot import FrankaRobot
from .wire import (
    CONNECT,
    GRIPPER_HEADER,
    GRIPPER_PORT,
    GRIPPER_VERSION,
    JOINT_COMMAND,
    ROBOT_HEADER,
    ROBOT_PORT,
    ROBOT_VERSION,
    Inbox,
    Request,
    message,
)

CYCLE = 0.001
"""s."""
BEHIND = 0.05
"""s: a clock that is late by more starts anew."""
HAND_EVERY = 10
"""Cycles between two states of the hand."""
LOOKS = 2
"""States of a motion that a client looks at before it answers one (libfranka: one when it has asked
for the motion, one before its first command)."""
FIRST = 0.01
"""s between those."""
PATIENCE = 0.3
"""s that a client then has for its first command; libfranka itself gives up after 1 s."""
IDLE = 0.5
"""s between two looks at whether somebody has connected."""
HAND_WAITS = 0.05
"""s after which the hand tells its state again though time stands still."""


class Line:
    """One listening port and the client that is connected, if any."""

    def __init__(self, address: str, port: int, header: Any, version: int, status: int) -> None:
        """`status`: bytes of a status."""
        self._header, self._version, self._status = header, version, status
        self.listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self.listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.listener.bind((address, port))
        self.listener.listen(4)
        self.listener.setblocking(False)
        self.datagrams = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.datagrams.bind((address, 0))
        self.datagrams.setblocking(False)
        self.client: socket.socket | None = None
        self._told: tuple[str, int] | None = None

    @property
    def sockets(self) -> list[socket.socket]:
        """What there may be something to read from."""
        both = [self.listener, self.datagrams]
        return both if self.client is None else [*both, self.client]

    def accept(self) -> None:
        """A client calls; the one before is cut off."""
        self.hang_up()
        self.client, _ = self.listener.accept()
        self.client.setblocking(False)
        self.client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._inbox = Inbox(self._header)

    def hang_up(self) -> None:
        """End the connection."""
        if self.client is not None:
            self.client.close()
        self.client = self._told = None

    def requests(self) -> list[Request]:
        """What the client asks; its greeting is answered here. It is hung up on when it is gone."""
        assert self.client is not None
        try:
            received = self.client.recv(65536)
        except BlockingIOError:
            return []
        except OSError:
            received = b""
        if not received:
            self.hang_up()
            return []
        out: list[Request] = []
        for asked in self._inbox.take(received):
            if asked.command == 0:
                self._greet(asked)
            else:
                out.append(asked)
        return out

    def _greet(self, asked: Request) -> None:
        assert self.client is not None
        version, port = CONNECT.unpack(asked.payload)
        fits = version == self._version
        status = int(not fits).to_bytes(self._status, "little")
        self.answer(asked, status + self._version.to_bytes(2, "little"))
        self._told = (self.client.getpeername()[0], port) if fits else None

    def answer(self, asked: Request, payload: bytes) -> None:
        """Over TCP."""
        if self.client is None:
            return
        self.client.setblocking(True)
        try:
            self.client.sendall(message(self._header, asked.command, asked.id, payload))
            self.client.setblocking(False)
        except OSError:
            self.hang_up()

    def tell(self, state: bytes | bytearray) -> None:
        """Over UDP, if anybody listens."""
        if self._told is not None:
            with suppress(OSError):
                self.datagrams.sendto(state, self._told)

    def close(self) -> None:
        """Let go of the ports."""
        self.hang_up()
        self.listener.close()
        self.datagrams.close()


class Server:
    """Serves one arm and its hand until it is told to stop.

    Attributes:
        frozen: neither hears nor says anything. seconds: s of a processor that the
            `cycles` took, in all.
    """

    def __init__(
        self,
        address: str,
        robot: FrankaRobot,
        hand: FrankaHand,
        *,
        lockstep: bool = True,
        pace: float = 1.0,
        fastest: float = math.inf,
        version: int = ROBOT_VERSION,
    ) -> None:
        """`version`: of the protocol that the arm speaks."""
        self._robot, self._hand, self._lockstep = robot, hand, lockstep
        self._cycle, self._shortest = CYCLE / pace, CYCLE / fastest
        self._arm_line = Line(address, ROBOT_PORT, ROBOT_HEADER, version, 1)
        self._hand_line = Line(address, GRIPPER_PORT, GRIPPER_HEADER, GRIPPER_VERSION, 2)
        self._command: NDArray[np.void] | None = None
        self._locked = False
        self._due = time.perf_counter()
        self._door: tuple[Any, Callable[[], bool]] | None = None
        self.frozen = False
        self.seconds, self.cycles = 0.0, 0

    def open_door(self, readable: Any, visit: Callable[[], bool]) -> None:
        """Call `visit` whenever `readable` is; it says whether to go on serving."""
        self._door = readable, visit

    def serve(self) -> None:
        """Until the door says that it is over."""
        try:
            while self._wait():
                self._step()
        finally:
            self.close()

    def close(self) -> None:
        """Let go of the ports."""
        self._arm_line.close()
        self._hand_line.close()

    def hang_up(self) -> None:
        """Cut both connections; the world goes on."""
        self._robot.abandoned()
        self._arm_line.hang_up()
        self._hand_line.hang_up()

    def _step(self) -> None:
        """One cycle of the world, and what is to be said after it."""
        began = time.process_time()
        robot, hand = self._robot, self._hand
        robot.cycle(self._command)
        hand.update()
        self._command = None
        self._locked = self._locked and robot.moving
        self._say()
        self.seconds += time.process_time() - began
        self.cycles += 1

    def _say(self) -> None:
        if self.frozen:
            return
        robot, number = self._robot, self._robot.message_id
        self._arm_line.tell(robot.state.bytes)
        self._answer()
        if number % HAND_EVERY == 0:
            self._hand_line.tell(self._hand.state(number))

    def _answer(self) -> None:
        """After the state that shows what came of it: whoever has an answer finds it done."""
        for line, served in ((self._arm_line, self._robot), (self._hand_line, self._hand)):
            for asked, payload in served.answers():
                line.answer(asked, payload)

    def _wait(self) -> bool:
        """Until the next cycle is due; whether there is to be one."""
        if self._locked and not self.frozen:
            return self._await_answer()
        self._schedule(self._spacing)
        while True:
            if not self._listen(self._left):
                return False
            if self._locked and self._command is not None:
                return True
            if self._left <= 0.0 and self._connected:
                return True

    @property
    def _spacing(self) -> float:
        """s between two cycles that wait for no answer. A client's first command answers a state
        after some that it only looked at: if that took it several cycles, the answers to them would
        be lost, and its motion would begin with a jump."""
        if not self._robot.moving:
            return self._cycle
        if not self._lockstep:
            return CYCLE
        return FIRST if self._robot.unanswered < LOOKS else PATIENCE

    def _schedule(self, cycle: float) -> None:
        """When the next cycle is due, s after the last one; a clock that is late starts anew."""
        self._due += cycle
        now = time.perf_counter()
        if now - self._due > BEHIND:
            self._due = now

    @property
    def _left(self) -> float:
        """s until the next cycle is due; where nobody is connected, until somebody looks."""
        left = max(self._due - time.perf_counter(), 0.0)
        return left if self._connected else max(left, IDLE)

    @property
    def _connected(self) -> bool:
        return self._arm_line.client is not None or self._hand_line.client is not None

    def _await_answer(self) -> bool:
        """Lockstep: the client's answer to the last state, or the end of its motion."""
        told = time.perf_counter()
        while self._robot.moving and self._command is None and not self.frozen:
            if not self._listen(HAND_WAITS):
                return False
            if time.perf_counter() - told > HAND_WAITS:
                told = time.perf_counter()
                self._hand_line.tell(self._hand.state(self._robot.message_id))
        self._schedule(self._shortest)
        while self._left > 0.0:
            if not self._listen(self._left):
                return False
        return True

    def _listen(self, seconds: float) -> bool:
        """What arrives within so many seconds, but no more than once; whether to go on serving."""
        arm, hand, door = self._arm_line, self._hand_line, self._door
        heard = [] if self.frozen else [*arm.sockets, *hand.sockets]
        if door is not None:
            heard.append(door[0])
        ready, _, _ = select.select(heard, [], [], seconds)
        if arm.datagrams in ready:
            self._hear()
        for line in (arm, hand):
            if line.client in ready:
                self._serve_line(line)
            if line.listener in ready:
                if line is arm:
                    self._robot.abandoned()
                line.accept()
        return not (door is not None and door[0] in ready) or door[1]()

    def _serve_line(self, line: Line) -> None:
        served = self._robot if line is self._arm_line else self._hand
        for asked in line.requests():
            served.request(asked)
        if self._locked and self._robot.moving:
            self._answer()
        if line.client is None and line is self._arm_line:
            self._robot.abandoned()

    def _hear(self) -> None:
        """A command: the answer to the present state, in lockstep; the newest, otherwise."""
        while True:
            try:
                received = self._arm_line.datagrams.recv(1024)
            except BlockingIOError:
                return
            except OSError:
                return
            if len(received) != JOINT_COMMAND.itemsize or not self._robot.moving:
                continue
            command = np.frombuffer(received, JOINT_COMMAND)[0]
            if self._locked and command["message_id"] != self._robot.message_id:
                continue
            self._command = command
            self._locked = self._lockstep
