"""The bytes that a Franka robot and its hand exchange with their clients: robot interface version
10, gripper interface version 3.

Laid out as in libfranka-common (Apache-2.0, https://github.com/frankarobotics/libfranka-common,
research_interface/robot/rbk_types.h, service_types.h, error.h, and gripper/types.h): packed, little
endian. States and joint commands go as UDP datagrams, everything else over TCP, with one header.
"""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

ROBOT_VERSION, GRIPPER_VERSION = 10, 3
ROBOT_PORT, GRIPPER_PORT = 1337, 1338
ERRORS = 41


class Command(IntEnum):
    """What a client asks a robot."""

    CONNECT = 0
    MOVE = 1
    STOP_MOVE = 2
    SET_COLLISION_BEHAVIOR = 3
    SET_JOINT_IMPEDANCE = 4
    SET_CARTESIAN_IMPEDANCE = 5
    SET_GUIDING_MODE = 6
    SET_EE_TO_K = 7
    SET_NE_TO_EE = 8
    SET_LOAD = 9
    AUTOMATIC_ERROR_RECOVERY = 10
    GET_ROBOT_MODEL = 11


class GripperCommand(IntEnum):
    """What a client asks a hand."""

    CONNECT = 0
    HOMING = 1
    GRASP = 2
    MOVE = 3
    STOP = 4


class GripperStatus(IntEnum):
    """How a hand's command ended."""

    SUCCESS = 0
    FAIL = 1
    UNSUCCESSFUL = 2
    ABORTED = 3


class MoveStatus(IntEnum):
    """What becomes of a motion."""

    SUCCESS = 0
    STARTED = 1
    PREEMPTED = 2
    PREEMPTED_BY_SAFETY = 3
    REJECTED_BY_SAFETY = 4
    NOT_POSSIBLE = 5
    SINGULAR = 6
    INVALID = 7
    REFLEX = 8
    EMERGENCY = 9
    INPUT_ERROR = 10
    ABORTED = 11


class StopStatus(IntEnum):
    """Of a command to stop."""

    SUCCESS = 0
    NOT_POSSIBLE = 1
    SAFETY = 2
    EMERGENCY = 3
    REFLEX = 4


class SetStatus(IntEnum):
    """Of a setting."""

    SUCCESS = 0
    NOT_POSSIBLE = 1
    INVALID = 2


class RecoveryStatus(IntEnum):
    """Of an automatic error recovery."""

    SUCCESS = 0
    NOT_POSSIBLE = 1
    SAFETY = 2
    MANUAL = 3
    REFLEX = 4
    EMERGENCY = 5


class RobotMode(IntEnum):
    """What a robot is doing."""

    OTHER = 0
    IDLE = 1
    MOVE = 2
    GUIDING = 3
    REFLEX = 4
    USER_STOPPED = 5
    RECOVERY = 6


class MotionMode(IntEnum):
    """Which kind of motion is commanded: as a state tells it. A command counts from one less."""

    IDLE = 0
    JOINT_POSITION = 1
    JOINT_VELOCITY = 2
    CARTESIAN_POSITION = 3
    CARTESIAN_VELOCITY = 4
    NONE = 5


class ControllerMode(IntEnum):
    """Who makes torques of it."""

    JOINT_IMPEDANCE = 0
    CARTESIAN_IMPEDANCE = 1
    EXTERNAL = 2
    OTHER = 3


class Error(IntEnum):
    """Places in a state's `errors`, of those that this server raises."""

    JOINT_POSITION_LIMITS = 0
    JOINT_VELOCITY = 3
    CARTESIAN_VELOCITY = 4
    JOINT_REFLEX = 6
    CARTESIAN_REFLEX = 7
    JOINT_START_POSE_INVALID = 11
    JOINT_MOTION_POSITION_LIMITS = 12
    JOINT_MOTION_VELOCITY_LIMITS = 13
    JOINT_VELOCITY_DISCONTINUITY = 14
    JOINT_ACCELERATION_DISCONTINUITY = 15
    CARTESIAN_START_POSE_INVALID = 16
    CARTESIAN_VELOCITY_LIMITS = 18
    CARTESIAN_VELOCITY_DISCONTINUITY = 19
    CARTESIAN_ACCELERATION_DISCONTINUITY = 20
    COMMUNICATION = 25
    TORQUE_DISCONTINUITY = 32
    TORQUE_RANGE = 34


_FLOATS = (
    ("O_T_EE", 16),
    ("O_T_EE_d", 16),
    ("F_T_EE", 16),
    ("EE_T_K", 16),
    ("F_T_NE", 16),
    ("NE_T_EE", 16),
    ("m_ee", 1),
    ("I_ee", 9),
    ("F_x_Cee", 3),
    ("m_load", 1),
    ("I_load", 9),
    ("F_x_Cload", 3),
    ("elbow", 2),
    ("elbow_d", 2),
    ("tau_J", 7),
    ("tau_J_d", 7),
    ("dtau_J", 7),
    ("q", 7),
    ("q_d", 7),
    ("dq", 7),
    ("dq_d", 7),
    ("ddq_d", 7),
    ("joint_contact", 7),
    ("cartesian_contact", 6),
    ("joint_collision", 7),
    ("cartesian_collision", 6),
    ("tau_ext_hat_filtered", 7),
    ("O_F_ext_hat_K", 6),
    ("K_F_ext_hat_K", 6),
    ("O_dP_EE_d", 6),
    ("O_ddP_O", 3),
    ("elbow_c", 2),
    ("delbow_c", 2),
    ("ddelbow_c", 2),
    ("O_T_EE_c", 16),
    ("O_dP_EE_c", 6),
    ("O_ddP_EE_c", 6),
    ("theta", 7),
    ("dtheta", 7),
    ("accelerometer_top", 18),
    ("accelerometer_bottom", 18),
)
STATE = np.dtype(
    [("message_id", "<u8")]
    + [(name, "<f4", (count,)) for name, count in _FLOATS]
    + [
        ("motion_generator_mode", "u1"),
        ("controller_mode", "u1"),
        ("errors", "u1", (ERRORS,)),
        ("reflex_reason", "u1", (ERRORS,)),
        ("robot_mode", "u1"),
        ("control_command_success_rate", "<f4"),
    ]
)
"""A robot's state, 1 kHz. Matrices are column-major, as all of libfranka's."""

_AT = {name: int(STATE.fields[name][1]) for name in STATE.names}
_NUMBER, _MODES, _MODE = struct.Struct("<Q"), struct.Struct("<BB"), struct.Struct("<Bf")

JOINT_COMMAND = np.dtype(
    [
        ("message_id", "<u8"),
        ("q_c", "<f8", (7,)),
        ("dq_c", "<f8", (7,)),
        ("O_T_EE_c", "<f8", (16,)),
        ("O_dP_EE_c", "<f8", (6,)),
        ("elbow_c", "<f8", (2,)),
        ("valid_elbow", "u1"),
        ("motion_finished", "u1"),
        ("tau_J_d", "<f8", (7,)),
        ("torque_finished", "u1"),
    ]
)
"""A client's answer to a state, which it names by its `message_id`."""

ROBOT_HEADER, GRIPPER_HEADER = struct.Struct("<III"), struct.Struct("<HII")
"""Command, id and size of the whole message, bytes."""

CONNECT = struct.Struct("<HH")
MOVE = struct.Struct("<II6d?7d")
GRASP, WIDTH = struct.Struct("<5d"), struct.Struct("<2d")
GRIPPER_STATE = struct.Struct("<Idd?H")


class Request(NamedTuple):
    """One message of a client over TCP."""

    command: int
    id: int
    payload: bytes


class Inbox:
    """Puts a stream of bytes together to messages."""

    def __init__(self, header: struct.Struct) -> None:
        self._header, self._bytes = header, b""

    def take(self, received: bytes) -> list[Request]:
        """What is complete with these bytes."""
        self._bytes += received
        out: list[Request] = []
        while len(self._bytes) >= self._header.size:
            command, number, size = self._header.unpack_from(self._bytes)
            if len(self._bytes) < size:
                break
            out.append(Request(command, number, self._bytes[self._header.size : size]))
            self._bytes = self._bytes[size:]
        return out


def message(header: struct.Struct, command: int, number: int, payload: bytes) -> bytes:
    """An answer, as it goes over TCP."""
    return header.pack(command, number, header.size + len(payload)) + payload


class StateBuffer:
    """A robot's state whose fields are written in place: 1 kHz leaves no time for more.

    Attributes:
        bytes: what goes over the wire. fields: each one as an array that writes through.
    """

    def __init__(self) -> None:
        self.bytes = bytearray(STATE.itemsize)
        record: Any = np.frombuffer(self.bytes, dtype=STATE)
        self.fields: dict[str, NDArray[Any]] = {name: record[name][0] for name, _ in _FLOATS}
        for name in ("errors", "reflex_reason"):
            self.fields[name] = record[name][0]

    def put(self, number: int, motion: int, controls: int, mode: int, rate: float) -> None:
        """Write what is no array."""
        _NUMBER.pack_into(self.bytes, 0, number)
        _MODES.pack_into(self.bytes, _AT["motion_generator_mode"], motion, controls)
        _MODE.pack_into(self.bytes, _AT["robot_mode"], mode, rate)


def matrix(values: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """(4, 4) of 16 numbers, column by column."""
    return np.asarray(values, dtype=np.float64).reshape(4, 4).T
