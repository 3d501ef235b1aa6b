"""ROS 2 messages as bytes: their definitions (common_interfaces, tf2_msgs, rcl_interfaces), and CDR, their
encoding, for a thousand messages of one layout at a time."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

LITTLE_ENDIAN = b"\x00\x01\x00\x00"
"""Header of every message: plain CDR, little-endian."""

DEFINITIONS = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "std_msgs/String": "string data",
    "std_msgs/Float64": "float64 data",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
    "geometry_msgs/PoseStamped": "std_msgs/Header header\ngeometry_msgs/Pose pose",
    "geometry_msgs/Twist": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular",
    "geometry_msgs/TwistStamped": "std_msgs/Header header\ngeometry_msgs/Twist twist",
    "geometry_msgs/Wrench": "geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque",
    "geometry_msgs/WrenchStamped": "std_msgs/Header header\ngeometry_msgs/Wrench wrench",
    "geometry_msgs/Transform": "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation",
    "geometry_msgs/TransformStamped": "std_msgs/Header header\nstring child_frame_id\n"
    "geometry_msgs/Transform transform",
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "sensor_msgs/JointState": "std_msgs/Header header\nstring[] name\nfloat64[] position\n"
    "float64[] velocity\nfloat64[] effort",
    "sensor_msgs/CompressedImage": "std_msgs/Header header\nstring format\nuint8[] data",
    "sensor_msgs/RegionOfInterest": "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\n"
    "bool do_rectify",
    "sensor_msgs/CameraInfo": "std_msgs/Header header\nuint32 height\nuint32 width\n"
    "string distortion_model\nfloat64[] d\nfloat64[9] k\nfloat64[9] r\nfloat64[12] p\n"
    "uint32 binning_x\nuint32 binning_y\nsensor_msgs/RegionOfInterest roi",
    "rcl_interfaces/Log": "byte DEBUG=10\nbyte INFO=20\nbyte WARN=30\nbyte ERROR=40\nbyte FATAL=50\n"
    "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\nstring function\n"
    "uint32 line",
}
"""Fields of each `package/Type`."""


def definition(datatype: str) -> str:
    """Return the full text of `package/Type`, as an MCAP schema carries it: its fields, then those of
    every type that they are made of."""
    parts = [DEFINITIONS[datatype]]
    parts += [f"MSG: {name}\n{DEFINITIONS[name]}" for name in dependencies(datatype)]
    # ros2msg concatenates definitions with a line of 80 equals signs.
    return ("\n" + "=" * 80 + "\n").join(parts) + "\n"


def dependencies(datatype: str) -> list[str]:
    """List the message types inside `datatype`, each once, outer ones first."""
    found: list[str] = []
    for name in re.findall(r"^(\w+/\w+)", DEFINITIONS[datatype], re.MULTILINE):
        found += [n for n in (name, *dependencies(name)) if n not in found]
    return list(dict.fromkeys(found))


class Field(NamedTuple):
    """Numbers that differ from message to message: `length` of dtype `kind` from byte `offset` on."""

    name: str
    offset: int
    kind: str
    length: int


class Layout:
    """Byte layout of a message, written from its first field to its last.

    Texts and array lengths are the same in every message; named fields are left open. `encode` fills
    them from arrays of n rows, `decode` reads them back: a list of messages is one numpy array of
    records, in which the texts are gaps between the fields.

    CDR aligns every number to a multiple of its own size, counted after the 4-byte header. A text is
    its length with the closing zero, its UTF-8 bytes and the zero; an array is its length and its
    items. A `geometry_msgs/PointStamped` is
    `Layout().time("stamp").text("world").doubles("point", 3)`:

        00 01 00 00 | sec | nanosec | 6 | w o r l d 0 | 0 0 | x | y | z
    """

    def __init__(self) -> None:
        self.constant = bytearray(LITTLE_ENDIAN)
        self.fields: list[Field] = []

    def uint8(self, value: int) -> Layout:
        """Append a constant byte."""
        self.constant.append(value)
        return self

    def uint32(self, *values: int) -> Layout:
        """Append constant unsigned integers of four bytes."""
        self._align(4)
        for value in values:
            self.constant += value.to_bytes(4, "little")
        return self

    def text(self, *values: str) -> Layout:
        """Append constant texts."""
        for value in values:
            self.octets(value.encode() + b"\0")
        return self

    def octets(self, content: bytes) -> Layout:
        """Append a constant array of bytes."""
        self.uint32(len(content))
        self.constant += content
        return self

    def texts(self, values: Sequence[str]) -> Layout:
        """Append a constant array of texts."""
        return self.uint32(len(values)).text(*values)

    def time(self, name: str) -> Layout:
        """Append an open field of seconds and nanoseconds: rows of two integers."""
        return self._field(name, "<u4", 2)

    def doubles(self, name: str, count: int) -> Layout:
        """Append an open field of `count` numbers, such as a vector's x, y and z."""
        return self._field(name, "<f8", count)

    def array(self, name: str, count: int) -> Layout:
        """Append an open array of `count` numbers."""
        return self.uint32(count).doubles(name, count)

    def empty_array(self) -> Layout:
        """Append an array without items."""
        return self.uint32(0)

    def encode(self, signals: Mapping[str, NDArray[Any]], n: int) -> list[bytes]:
        """Encode `n` messages from arrays (n, count) by field name; a name may occur several times."""
        rows = np.frombuffer(bytearray(self.constant * n), self._dtype())
        for place, field in enumerate(self.fields):
            rows[str(place)] = signals[field.name]
        return rows.view(f"V{len(self.constant)}").tolist()

    def decode(self, messages: Sequence[bytes]) -> dict[str, NDArray[Any]]:
        """Decode the fields of n `messages`, by name, (n, count) each.

        Raises:
            ValueError: a message is longer or shorter than this layout.
        """
        if any(len(message) != len(self.constant) for message in messages):
            raise ValueError(f"a message does not have {len(self.constant)} bytes")
        rows = np.frombuffer(b"".join(messages), self._dtype())
        return {field.name: rows[str(place)].copy() for place, field in enumerate(self.fields)}

    def _dtype(self) -> np.dtype[np.void]:
        # Fields are named by their position, because a name may occur twice.
        names = [str(place) for place in range(len(self.fields))]
        formats = [(field.kind, (field.length,)) for field in self.fields]
        offsets = [field.offset for field in self.fields]
        size = len(self.constant)
        return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": size})

    def _field(self, name: str, kind: str, length: int) -> Layout:
        size = np.dtype(kind).itemsize
        self._align(size)
        self.fields.append(Field(name, len(self.constant), kind, length))
        self.constant += bytes(size * length)
        return self

    def _align(self, size: int) -> None:
        self.constant += bytes(-(len(self.constant) - len(LITTLE_ENDIAN)) % size)
