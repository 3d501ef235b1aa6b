"""Check of a control box before planning: it answers, in a supported protocol."""

from __future__ import annotations

import socket
import struct
from dataclasses import dataclass

from palpate.errors import Unavailable
from palpate.robots.franky.address import Address
from palpate.robots.franky.library import franky

ROBOT_PORT, GRIPPER_PORT = 1337, 1338
"""libfranka's command ports of the arm and of the hand."""
ANSWERS = 2.0
"""s in which a control box takes a connection, and answers a greeting."""
SPOKEN = 10
"""Version of the robot interface of libfranka 0.18 and later, which franky-control 2.0 is built with
(libfranka-common, research_interface/robot/rbk_types.h and service_types.h)."""

_GREETING = struct.Struct("<IIIHH")
"""Command, id and size of the message; version and UDP port."""
_MESSAGE = struct.Struct("<III")
"""Command, id and size of a message that says no more; an answer to it has a status besides."""
RECOVER = 10
"""AutomaticErrorRecovery (rbk_types.h)."""
INCOMPATIBLE = 1
"""The status of an answer that refuses the version; 0 accepts it (service_types.h)."""
_ANSWER = struct.Struct("<IIIBH")
"""Command, id and size of the message; status and version."""


@dataclass(frozen=True, slots=True)
class Greeting:
    """Answer of a control box: its protocol version, None where it said nothing that we
    understand; why it cannot be used, None where it can."""

    version: int | None
    problem: str | None


def greet(address: Address) -> Greeting:
    """Say hello at the arm's port, as libfranka does, and hang up."""
    try:
        with _line(address) as line:
            answer = _greeted(line)
    except TimeoutError:
        return Greeting(None, f"it says nothing within {ANSWERS:g} s: {ACTIVATE}")
    except OSError as error:
        reason = error.strerror or str(error) or type(error).__name__
        return Greeting(
            None, f"{reason}: is it switched on, and in this computer's network? {ACTIVATE}"
        )
    if len(answer) < _ANSWER.size:
        return Greeting(None, f"it hangs up: {ACTIVATE}")
    command, number, size, refused, version = _ANSWER.unpack(answer)
    if (command, number) != (0, 0) or size < _ANSWER.size or refused > INCOMPATIBLE:
        return Greeting(None, STRANGER.format(answer=answer))
    if refused:
        return Greeting(version, WHEEL.format(theirs=version, ours=SPOKEN))
    return Greeting(version, None)


def clear(address: Address) -> None:
    """Clear the error that stopped an arm, because a person says so: franky's own robot, which could,
    cannot be made of a stopped arm.

    Raises:
        Unavailable: nobody answers.
    """
    try:
        with _line(address) as line:
            _greeted(line)
            line.sendall(_MESSAGE.pack(RECOVER, 1, _MESSAGE.size))
            line.recv(_MESSAGE.size + 1, socket.MSG_WAITALL)
    except OSError as error:
        raise Unavailable(f"the robot at {address} does not answer: {error}") from error


def _line(address: Address) -> socket.socket:
    line = socket.create_connection((address.host, ROBOT_PORT), ANSWERS)
    line.settimeout(ANSWERS)
    return line


def _greeted(line: socket.socket) -> bytes:
    """Return the answer to a greeting."""
    line.sendall(_GREETING.pack(0, 0, _GREETING.size, SPOKEN, line.getsockname()[1]))
    return line.recv(_ANSWER.size, socket.MSG_WAITALL)


ACTIVATE = "activate FCI in Desk, and see that no other program is connected"
STRANGER = (
    "something else answers at its port, which begins with {answer!r} and is no control box of a Franka: see "
    "that the address is the one under which Desk opens"
)
WHEEL = (
    "it speaks version {theirs} of the robot interface, and this franky-control version {ours}: install "
    "the wheel that is built for its system version (README of franky-control, compatibility)"
)


def require_answer(address: Address) -> None:
    """Require that the control box answers and the driver is installed.

    Raises:
        Unavailable: it does not; the message says what to do.
    """
    greeting = greet(address)
    if greeting.problem is not None:
        raise Unavailable(f"the robot at {address} cannot be used: {greeting.problem}")
    franky()
