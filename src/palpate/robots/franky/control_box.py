"""A Franka's control box, the library `franky` that communicates with it, and descriptions of its
faults.
"""

from __future__ import annotations

import ipaddress
import re
import socket
import struct
from dataclasses import dataclass
from functools import cache
from types import ModuleType
from typing import Any
from urllib.parse import parse_qsl, urlsplit

from palpate.common.errors import InputError, Unavailable


@cache
def franky() -> ModuleType:
    """Load the module. Raises Unavailable: it is not installed, or does not load."""
    try:
        import franky as module  # pyright: ignore[reportMissingTypeStubs]
    except ImportError as error:
        raise Unavailable(
            "the driver for a Franka is not installed: pip install 'palpate[franky]' (Linux on "
            f"x86_64): {error}"
        ) from error
    return module


# Address of a Franka's control box, `franky://HOST[?realtime=ignore]`, and a check that it answers in a
# supported protocol.


SCHEME = "franky"
FORM = "franky://HOST, e.g. franky://172.16.0.2, or franky://HOST?realtime=ignore"
ROBOT_PORT = 1337  # libfranka's command port of the arm
ANSWERS = 2.0  # s in which a control box, an arm and a hand answer
# Version of the robot interface of libfranka 0.18 and later, with which franky-control 2.0 is built
# (libfranka-common, research_interface/robot/rbk_types.h and service_types.h).
SPOKEN = 10
RECOVER = 10  # the command AutomaticErrorRecovery (rbk_types.h)
INCOMPATIBLE = 1  # status of an answer that refuses the version; 0 accepts it (service_types.h)

_HOST = re.compile(r"[A-Za-z0-9._:-]+")
# Each message begins with its command, id and size.
_GREETING = struct.Struct("<IIIHH")  # version and UDP port
_MESSAGE = struct.Struct("<III")  # header alone; an answer to it ends with a status
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
    """Address of a control box."""

    host: str  # its name or IP address
    # True if this computer must have a realtime kernel, as a 1 kHz control loop needs; False on
    # loopback, where no arm moves.
    realtime: bool = True

    def __str__(self) -> str:
        return f"{SCHEME}://{self.host}"


def read_address(url: str) -> Address:
    """Parse a URL."""
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
    """Greet the arm's port, as libfranka does, and disconnect."""
    try:
        with _connect(address) as line:
            answer = _read_greeting(line)
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

    Raises Unavailable: no answer or no driver; the message names the remedy.
    """
    if (problem := greet(address).problem) is not None:
        raise Unavailable(f"the robot at {address} cannot be used: {problem}")
    franky()


def clear(address: Address) -> None:
    """Clear the error that stopped an arm, on a person's order.

    It works without franky, whose robot object cannot be created for a stopped arm. Raises Unavailable: no answer.
    """
    try:
        with _connect(address) as line:
            _read_greeting(line)
            line.sendall(_MESSAGE.pack(RECOVER, 1, _MESSAGE.size))
            line.recv(_MESSAGE.size + 1, socket.MSG_WAITALL)
    except OSError as error:
        raise Unavailable(f"the robot at {address} does not answer: {error}") from error


def _connect(address: Address) -> socket.socket:
    line = socket.create_connection((address.host, ROBOT_PORT), ANSWERS)
    line.settimeout(ANSWERS)
    return line


def _read_greeting(line: socket.socket) -> bytes:
    """Return the answer to a greeting."""
    line.sendall(_GREETING.pack(0, 0, _GREETING.size, SPOKEN, line.getsockname()[1]))
    return line.recv(_ANSWER.size, socket.MSG_WAITALL)


# Messages for franky's exceptions and the modes of a control box, each with a remedy.


MODES = {  # descriptions of the control box's modes
    "Other": "not ready (brakes closed, or another mode in Desk)",
    "Idle": "ready",
    "Move": "moving",
    "Guiding": "guided by hand",
    "Reflex": "stopped by a reflex",
    "UserStopped": "stopped by the user stop",
    "AutomaticErrorRecovery": "recovering",
}
REMEDIES = {  # all by a person: no program restarts a stopped arm
    "UserStopped": "release the user stop, see that nothing is held or in the way, and run again",
    "Reflex": "see what it met, clear the error in Desk, and run again",
    "Guiding": "take the hands off the guiding button, and run again",
    "Other": "open the brakes and activate FCI in Desk, and run again",
}


def mode_of(state: Any) -> str:
    """Return the name of the control box's mode."""
    return str(state.robot_mode.name)


def errors_of(state: Any) -> list[str]:
    """List the errors that are set, by libfranka's names."""
    errors = state.current_errors
    return [
        name for name in dir(errors) if not name.startswith("_") and getattr(errors, name) is True
    ]


def of_mode(state: Any) -> str | None:
    """Return the reason that an arm in this mode cannot move; None if it can."""
    mode = mode_of(state)
    if mode in ("Idle", "Move"):
        return None
    return f"the arm is {MODES.get(mode, mode)}: {REMEDIES.get(mode, 'look at Desk')}"


def of_error(error: BaseException, mode: str | None = None) -> str:
    """Describe the error of a motion."""
    text = " ".join(str(error).split())
    lowered = text.lower()
    if "user stop" in lowered or mode == "UserStopped":
        return f"the user stop was pressed: {REMEDIES['UserStopped']}"
    if is_network(error):
        return "the connection to the control box is lost: look at the network cable and at Desk"
    if "reflex" in lowered or mode == "Reflex":
        return f"the arm stopped itself ({text}): {REMEDIES['Reflex']}"
    if "communication_constraints" in lowered:
        return (
            "too many of the control box's cycles got no answer in time: use a realtime kernel, and a "
            f"network card and cable of its own ({text})"
        )
    return f"{type(error).__name__}: {text}"


def is_network(error: BaseException) -> bool:
    """Test for a lost connection, which franky reports in several ways."""
    text = str(error).lower()
    return "net exception" in text or "udp" in text or type(error).__name__ == "NetworkException"
