"""A Franka's control box: its address `franky://HOST[?realtime=ignore]`, and a check that it
answers, in a supported protocol."""

from __future__ import annotations

import ipaddress
import re
import socket
import struct
from dataclasses import dataclass
from urllib.parse import parse_qsl, urlsplit

from palpate.errors import InputError, Unavailable
from palpate.robots.franky.library import franky

SCHEME = "franky"
FORM = "franky://HOST, e.g. franky://172.16.0.2, or franky://HOST?realtime=ignore"
ROBOT_PORT = 1337  # libfranka's command port of the arm
ANSWERS = 2.0  # s in which a control box takes a connection, and answers a greeting
SPOKEN = 10
"""Version of the robot interface of libfranka 0.18 and later, which franky-control 2.0 is built with
(libfranka-common, research_interface/robot/rbk_types.h and service_types.h)."""
RECOVER = 10  # the command AutomaticErrorRecovery (rbk_types.h)
INCOMPATIBLE = 1  # status of an answer that refuses the version; 0 accepts it (service_types.h)

_HOST = re.compile(r"[A-Za-z0-9._:-]+")
# Each message begins with its command, id and size.
_GREETING = struct.Struct("<IIIHH")  # version and UDP port
_MESSAGE = struct.Struct("<III")  # no more; an answer to it ends with a status
_ANSWER = struct.Struct("<IIIBH")  # status and version

ACTIVATE = "activate FCI in Desk, and see that no other program is connected"
STRANGER = (
    "something else answers at its port, which begins with {answer!r} and is no control box of a Franka: see "
    "that the address is the one under which Desk opens"
)
WHEEL = (
    "it speaks version {theirs} of the robot interface, and this franky-control version {ours}: install "
    "the wheel that is built for its system version (README of franky-control, compatibility)"
)


@dataclass(frozen=True, slots=True)
class Address:
    """Address of a control box.

    Attributes:
        host: its name or IP address.
        realtime: True if this computer must have a realtime kernel, as a control loop of 1 kHz
            needs; not on loopback, where no arm moves.
    """

    host: str
    realtime: bool = True

    def __str__(self) -> str:
        return f"{SCHEME}://{self.host}"


def read_address(url: str) -> Address:
    """Parse a URL.

    Raises:
        InputError: not of the form.
    """
    parts = urlsplit(url)
    host = parts.netloc
    options = dict(parse_qsl(parts.query, keep_blank_values=True))
    realtime = options.pop("realtime", None)
    bare = parts.path in ("", "/") and not parts.fragment and not options
    if parts.scheme != SCHEME or not _HOST.fullmatch(host) or not bare:
        raise InputError(f"'{url}' is no address of a Franka: give {FORM}")
    if realtime not in (None, "ignore", "enforce"):
        raise InputError(f"realtime={realtime} in '{url}': valid: enforce, ignore")
    if realtime is not None:
        return Address(host, realtime == "enforce")
    try:
        return Address(host, not ipaddress.ip_address(host).is_loopback)
    except ValueError:  # a name
        return Address(host, host != "localhost")


@dataclass(frozen=True, slots=True)
class Greeting:
    """Answer of a control box to a greeting."""

    version: int | None  # of its protocol; None without an intelligible answer
    problem: str | None  # reason that it cannot be used; None if it can


def greet(address: Address) -> Greeting:
    """Greet the arm's port, as libfranka does, and hang up."""
    try:
        with _connect(address) as line:
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


def require_answer(address: Address) -> None:
    """Require that the control box answers and the driver is installed.

    Raises:
        Unavailable: it does not; the message names the remedy.
    """
    if (problem := greet(address).problem) is not None:
        raise Unavailable(f"the robot at {address} cannot be used: {problem}")
    franky()


def clear(address: Address) -> None:
    """Clear the error that stopped an arm, on a person's order, without franky: its robot object
    cannot be made of a stopped arm.

    Raises:
        Unavailable: no answer.
    """
    try:
        with _connect(address) as line:
            _greeted(line)
            line.sendall(_MESSAGE.pack(RECOVER, 1, _MESSAGE.size))
            line.recv(_MESSAGE.size + 1, socket.MSG_WAITALL)
    except OSError as error:
        raise Unavailable(f"the robot at {address} does not answer: {error}") from error


def _connect(address: Address) -> socket.socket:
    line = socket.create_connection((address.host, ROBOT_PORT), ANSWERS)
    line.settimeout(ANSWERS)
    return line


def _greeted(line: socket.socket) -> bytes:
    """Return the answer to a greeting."""
    line.sendall(_GREETING.pack(0, 0, _GREETING.size, SPOKEN, line.getsockname()[1]))
    return line.recv(_ANSWER.size, socket.MSG_WAITALL)
