"""ROS 2 messages: definitions, CDR encoding, and the topics of `trace.mcap`."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.common.pose import Array
from palpate.trace.recording import LeafRun, NominalHand
from palpate.trace.samples import Samples, Trace

LITTLE_ENDIAN = b"\x00\x01\x00\x00"  # Header of every message: plain CDR, little-endian

MESSAGES = Path(__file__).with_name("messages.msg")


@cache
def definitions() -> dict[str, str]:
    """Return the fields of each `package/Type`, from the file of definitions."""
    _, *parts = re.split(r"^MSG: ", MESSAGES.read_text("utf-8"), flags=re.MULTILINE)
    return {name: fields.strip() for name, _, fields in (part.partition("\n") for part in parts)}


def definition(datatype: str) -> str:
    """Return the full text of `package/Type` for an MCAP schema: its fields, then those of all its component
    types.
    """
    # Own fields first, then the definitions of the component types.
    parts = [definitions()[datatype]]
    parts += [f"MSG: {name}\n{definitions()[name]}" for name in dependencies(datatype)]
    # ros2msg concatenates definitions with a line of 80 equals signs.
    return ("\n" + "=" * 80 + "\n").join(parts) + "\n"


def dependencies(datatype: str) -> list[str]:
    """List the message types inside `datatype`, each once, outer ones first."""
    found: list[str] = []
    for name in re.findall(r"^(\w+/\w+)", definitions()[datatype], re.MULTILINE):
        found += [n for n in (name, *dependencies(name)) if n not in found]
    return list(dict.fromkeys(found))


class Field(NamedTuple):
    """Numbers that differ between messages: `length` of dtype `kind` from byte `offset` on."""

    name: str
    offset: int
    kind: str
    length: int


class Layout:
    """Byte layout of a message, written from its first field to its last.

    Texts and array lengths are equal in all messages; named fields are left open. `encode` fills them from
    arrays of n rows, `decode` reads them back. A list of messages is one numpy array of records, in which
    the texts are gaps between the fields.

    CDR aligns every number to a multiple of its own size, counted after the 4-byte header. A text is its
    length with the closing zero, its UTF-8 bytes and the zero. An array is its length and its items. A
    `geometry_msgs/PointStamped` is `Layout().time("stamp").text("world").doubles("point", 3)`:

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
        # n copies of the constant bytes, viewed as records whose fields are then filled.
        rows = np.frombuffer(bytearray(self.constant * n), self._dtype())
        for place, field in enumerate(self.fields):
            rows[str(place)] = signals[field.name]
        return rows.view(f"V{len(self.constant)}").tolist()

    def decode(self, messages: Sequence[bytes]) -> dict[str, NDArray[Any]]:
        """Decode the fields of n `messages`, by name, (n, count) each.

        Raises ValueError: a message is longer or shorter than this layout.
        """
        if any(len(message) != len(self.constant) for message in messages):
            raise ValueError(f"a message does not have {len(self.constant)} bytes")
        # View the joined bytes as records.
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
        # Align, and reserve zero bytes for the field.
        size = np.dtype(kind).itemsize
        self._align(size)
        self.fields.append(Field(name, len(self.constant), kind, length))
        self.constant += bytes(size * length)
        return self

    def _align(self, size: int) -> None:
        self.constant += bytes(-(len(self.constant) - len(LITTLE_ENDIAN)) % size)


# Topics of `trace.mcap`: conversion between samples, events and ROS 2 messages.


WORLD, TCP, TCP_WORLD_AXES, SENSOR = "world", "tcp", "tcp_world_axes", "wrench_sensor"
# Levels of `rcl_interfaces/Log`: INFO, WARN and ERROR, by a leaf's status.
LEVELS = {"SUCCESS": 20, "INVALID": 30, "FAILURE": 40}


class Message(NamedTuple):
    """Message of a topic; `time` in ns."""

    time: int
    topic: str
    datatype: str
    data: bytes


def header(frame: str) -> Layout:
    """Begin a layout with `std_msgs/Header`; `stamp` is open."""
    return Layout().time("stamp").text(frame)


def topics(hand: NominalHand) -> dict[str, tuple[str, Layout]]:
    """Return datatype and layout of each topic with one message per sample; joints have the names of
    `hand`.
    """
    # Poses of the TCP: measured and commanded.
    joint_states = "sensor_msgs/JointState"
    pose = header(WORLD).doubles("position", 3).doubles("orientation", 4)
    target = header(WORLD).doubles("target_position", 3).doubles("target_orientation", 4)
    # JointState holds arrays of positions, velocities and efforts; those without a sensor are empty.
    count = len(hand.joints)
    arm = header(WORLD).texts(hand.joints).array("q", count).array("dq", count).empty_array()
    gripper = header(WORLD).texts(hand.fingers).array("fingers", 2).empty_array().empty_array()
    efforts = header(WORLD).texts(hand.joints).empty_array().empty_array()
    efforts = efforts.array("tau_ext", count)
    # `tcp_world_axes` moves with the TCP but never turns: the frame of wrench and twist.
    transforms = Layout().uint32(2 if hand.wrench_sensor is None else 3)
    for frame, orientation in ((TCP, "orientation"), (TCP_WORLD_AXES, "unturned")):
        transforms.time("stamp").text(WORLD, frame).doubles("position", 3).doubles(orientation, 4)
    found = {
        "/robot_time": ("std_msgs/Float64", Layout().doubles("t", 1)),
        "/joint_states": (joint_states, arm),
        "/gripper/joint_states": (joint_states, gripper),
        "/external_joint_torques": (joint_states, efforts),
        "/wrench": ("geometry_msgs/WrenchStamped", header(TCP_WORLD_AXES).doubles("wrench", 6)),
        "/tcp_pose": ("geometry_msgs/PoseStamped", pose),
        "/tcp_target": ("geometry_msgs/PoseStamped", target),
        "/tcp_twist": ("geometry_msgs/TwistStamped", header(TCP_WORLD_AXES).doubles("twist", 6)),
        "/tf": ("tf2_msgs/TFMessage", transforms),
    }
    # The sensor's frame does not move against the TCP.
    if hand.wrench_sensor is not None:
        transforms.time("stamp").text(TCP, SENSOR)
        transforms.doubles("sensor_position", 3).doubles("sensor_orientation", 4)
        sensed = header(SENSOR).doubles("wrench_sensor", 6)
        found["/wrench_sensor"] = ("geometry_msgs/WrenchStamped", sensed)
    return found


def messages(trace: Trace, shown: Sequence[Message] = ()) -> list[Message]:
    """Convert a trace to messages in order of time; at equal times `shown` comes first, then samples, then
    events.
    """
    # One message per sample and topic, then the events.
    everything = [*shown]
    signals, times = signals_of(trace.samples), nanoseconds(trace.samples.t).tolist()
    if trace.hand.wrench_sensor is not None:
        place = np.array([trace.hand.wrench_sensor.pose_tcp_sensor])
        signals |= {"sensor_position": place[:, :3], "sensor_orientation": xyzw(place)}
    for name, (datatype, layout) in topics(trace.hand).items():
        for time, data in zip(times, layout.encode(signals, len(times)), strict=True):
            everything.append(Message(time, name, datatype, data))
    # Python's sort is stable: it keeps this order at equal times.
    return sorted([*everything, *events(trace)], key=lambda message: message.time)


def samples_of(messages: Mapping[str, Sequence[bytes]], hand: NominalHand) -> Samples:
    """Convert `messages`, by topic, back to samples.

    Raises ValueError: a topic lacks rows, or a message has another size.
    """
    # Decode the fields of all topics, and assemble the samples from them.
    signals: dict[str, NDArray[Any]] = {}
    for name, (_, layout) in topics(hand).items():
        signals |= layout.decode(messages.get(name, ()))
    samples = Samples(
        t=signals["t"][:, 0],
        q=signals["q"],
        dq=signals["dq"],
        tau_ext=signals["tau_ext"],
        wrench=signals["wrench"],
        pose_world_tcp=_pose(signals["position"], signals["orientation"]),
        twist=signals["twist"],
        target_world_tcp=_pose(signals["target_position"], signals["target_orientation"]),
        width=signals["fingers"].sum(axis=1),
        wrench_sensor=signals.get("wrench_sensor", np.empty((0, 0))),
    )
    # Every topic must have one message per sample.
    for field in fields(Samples):
        if len(getattr(samples, field.name)) != len(samples):
            raise ValueError(f"{field.name} lacks samples")
    return samples


def signals_of(s: Samples) -> dict[str, NDArray[Any]]:
    """Return the values of the open fields of all layouts, one row per sample."""
    return {
        "stamp": stamps(s.t),
        "t": s.t[:, None],
        "q": s.q,
        "dq": s.dq,
        "tau_ext": s.tau_ext,
        "wrench": s.wrench,
        "wrench_sensor": s.wrench_sensor,
        "position": s.pose_world_tcp[:, :3],
        "orientation": xyzw(s.pose_world_tcp),
        "unturned": np.array([0.0, 0.0, 0.0, 1.0]),
        "twist": s.twist,
        "target_position": s.target_world_tcp[:, :3],
        "target_orientation": xyzw(s.target_world_tcp),
        "fingers": np.column_stack([s.width / 2, s.width / 2]),
    }


def xyzw(pose: Array) -> Array:
    """Return the quaternions of poses (n, 7) in ROS's order xyzw; palpate's order is wxyz."""
    return pose[:, [4, 5, 6, 3]]


def _pose(position: Array, orientation: Array) -> Array:
    return np.column_stack([position, orientation[:, [3, 0, 1, 2]]])


def stamps(t: Array) -> NDArray[np.int64]:
    """Split times (n,) in s into (n, 2) seconds and nanoseconds."""
    return np.column_stack(np.divmod(nanoseconds(t), 1_000_000_000))


def nanoseconds(t: Array) -> NDArray[np.int64]:
    """Convert s to ns; MCAP has neither negative times nor NaN, which become 0."""
    return np.maximum(0, np.rint(np.nan_to_num(t) * 1e9)).astype(np.int64)


def nanosecond(t: float) -> int:
    """Convert one time from s to ns; 0 if it is negative or not finite."""
    return max(0, round(t * 1e9)) if math.isfinite(t) else 0


def events(trace: Trace) -> list[Message]:
    """Make the messages at begin and end of leaves and recordings, and of conversions."""
    found: list[Message] = []
    for leaf in trace.leaves:
        # A leaf has a message at its start, one at its end, and a log entry.
        about = {"node": leaf.node, "primitive": leaf.primitive, "label": leaf.label}
        ended = {**about, "event": leaf.status, "message": leaf.message}
        found.append(text(leaf.start, "/step", leaf.label))
        found.append(text(leaf.start, "/leaves", {**about, "event": "start"}))
        found.append(text(leaf.end, "/leaves", ended))
        found.append(log_entry(leaf))
    for recording in trace.recordings:
        # A recording has a message at its start and one at its end.
        content = asdict(recording)
        found.append(text(recording.start, "/recordings", {"event": "start", **content}))
        found.append(text(recording.end, "/recordings", {"event": "end", **content}))
    for conversion in trace.conversions:
        found.append(text(conversion.time, "/conversions", asdict(conversion)))
    return found


def text(t: float, topic: str, content: str | dict[str, Any]) -> Message:
    """Make a `std_msgs/String` at `t`, s, with JSON if the content is no text."""
    words = content if isinstance(content, str) else json.dumps(content, ensure_ascii=False)
    return message(t, topic, "std_msgs/String", Layout().text(words))


def log_entry(leaf: LeafRun) -> Message:
    """Make the `rcl_interfaces/Log` of a leaf's end: stamp, level, name, text, and no source location."""
    # Text of the log entry: label, status and message.
    content = ", ".join(filter(None, (f"{leaf.label}: {leaf.status}", leaf.message)))
    stamp = divmod(nanosecond(leaf.end), 1_000_000_000)
    layout = Layout().uint32(*stamp).uint8(LEVELS[leaf.status])
    layout.text(leaf.node, content, "", "").uint32(0)
    return message(leaf.end, "/rosout", "rcl_interfaces/Log", layout)


def message(t: float, topic: str, datatype: str, layout: Layout) -> Message:
    """Make a message from a `layout` without open fields, at `t`, s."""
    return Message(nanosecond(t), topic, datatype, bytes(layout.constant))
