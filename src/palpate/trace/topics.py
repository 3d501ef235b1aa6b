"""Topics of `trace.mcap`: conversion of samples and events to ROS 2 messages, and of messages to samples.

Log time and stamps are robot time, from 0. One message per sample:

| topic | message | content |
|---|---|---|
| `/joint_states` | JointState | joints 1–7: position rad, velocity rad/s |
| `/gripper/joint_states` | JointState | both fingers: position m, half the opening each |
| `/external_joint_torques` | JointState | joints 1–7: effort N m, measured less nominal gravity and friction |
| `/wrench` | WrenchStamped | exerted by the hand on the outside, about the TCP: frame `tcp_world_axes` |
| `/tcp_pose`, `/tcp_target` | PoseStamped | TCP measured and commanded, in `world` |
| `/tcp_twist` | TwistStamped | TCP velocity, in world axes: frame `tcp_world_axes` |
| `/tf` | TFMessage | `world` → `tcp`, and `world` → `tcp_world_axes` (at the TCP, turned like the world) |
| `/robot_time` | Float64 | robot time in s, to the last bit |

Events: `/step` (String, the action that begins), `/leaves`, `/recordings` and `/conversions` (String, JSON)
and `/rosout` (Log). `palpate.runs.shown` adds the robot model and the camera picture.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.geometry.pose import Array
from palpate.trace.recording import Hand, LeafRun
from palpate.trace.ros2 import Layout
from palpate.trace.samples import Samples, Trace

WORLD, TCP, TCP_WORLD_AXES = "world", "tcp", "tcp_world_axes"
LEVELS = {"SUCCESS": 20, "INVALID": 30, "FAILURE": 40}
"""Levels of `rcl_interfaces/Log`: INFO, WARN and ERROR, by a leaf's status."""


class Message(NamedTuple):
    """Message of a topic; `time` in ns."""

    time: int
    topic: str
    datatype: str
    data: bytes


def header(frame: str) -> Layout:
    """Begin a layout with `std_msgs/Header`; `stamp` is open."""
    return Layout().time("stamp").text(frame)


def topics(hand: Hand) -> dict[str, tuple[str, Layout]]:
    """Datatype and layout of each topic with one message per sample; joints named as in `hand`."""
    joint_states = "sensor_msgs/JointState"
    pose = header(WORLD).doubles("position", 3).doubles("orientation", 4)
    target = header(WORLD).doubles("target_position", 3).doubles("target_orientation", 4)
    # JointState holds arrays of positions, velocities and efforts; those without a sensor are empty.
    arm = header(WORLD).texts(hand.joints).array("q", 7).array("dq", 7).empty_array()
    gripper = header(WORLD).texts(hand.fingers).array("fingers", 2).empty_array().empty_array()
    efforts = header(WORLD).texts(hand.joints).empty_array().empty_array().array("tau_ext", 7)
    # `tcp_world_axes` moves with the TCP and never turns: the frame of wrench and twist.
    transforms = Layout().uint32(2)
    for frame, orientation in ((TCP, "orientation"), (TCP_WORLD_AXES, "unturned")):
        transforms.time("stamp").text(WORLD, frame).doubles("position", 3).doubles(orientation, 4)
    return {
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


def messages(trace: Trace, shown: Sequence[Message] = ()) -> list[Message]:
    """Convert a trace to messages in order of time; at equal times `shown` comes first, then samples,
    then events."""
    everything = [*shown]
    signals, times = signals_of(trace.samples), nanoseconds(trace.samples.t).tolist()
    for name, (datatype, layout) in topics(trace.hand).items():
        for time, data in zip(times, layout.encode(signals, len(times)), strict=True):
            everything.append(Message(time, name, datatype, data))
    # Python's sort is stable: it keeps this order within one instant.
    return sorted([*everything, *events(trace)], key=lambda message: message.time)


def samples_of(messages: Mapping[str, Sequence[bytes]], hand: Hand) -> Samples:
    """Convert `messages`, by topic, back to samples.

    Raises:
        ValueError: a topic lacks rows, or a message has another size.
    """
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
    )
    for field in fields(Samples):
        if len(getattr(samples, field.name)) != len(samples):
            raise ValueError(f"{field.name} lacks samples")
    return samples


def signals_of(s: Samples) -> dict[str, NDArray[Any]]:
    """Values of the open fields of all layouts, a row per sample."""
    return {
        "stamp": stamps(s.t),
        "t": s.t[:, None],
        "q": s.q,
        "dq": s.dq,
        "tau_ext": s.tau_ext,
        "wrench": s.wrench,
        "position": s.pose_world_tcp[:, :3],
        "orientation": xyzw(s.pose_world_tcp),
        "unturned": np.array([0.0, 0.0, 0.0, 1.0]),
        "twist": s.twist,
        "target_position": s.target_world_tcp[:, :3],
        "target_orientation": xyzw(s.target_world_tcp),
        "fingers": np.column_stack([s.width / 2, s.width / 2]),
    }


def xyzw(pose: Array) -> Array:
    """Quaternions of poses (n, 7) in the order of ROS; palpate's begin with w."""
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
    """Messages at begin and end of leaves and recordings, and of conversions."""
    found: list[Message] = []
    for leaf in trace.leaves:
        about = {"node": leaf.node, "primitive": leaf.primitive, "label": leaf.label}
        ended = {**about, "event": leaf.status, "message": leaf.message}
        found.append(text(leaf.start, "/step", leaf.label))
        found.append(json_text(leaf.start, "/leaves", {**about, "event": "start"}))
        found.append(json_text(leaf.end, "/leaves", ended))
        found.append(log_entry(leaf))
    for recording in trace.recordings:
        content = asdict(recording)
        found.append(json_text(recording.start, "/recordings", {"event": "start", **content}))
        found.append(json_text(recording.end, "/recordings", {"event": "end", **content}))
    for conversion in trace.conversions:
        found.append(json_text(conversion.time, "/conversions", asdict(conversion)))
    return found


def text(t: float, topic: str, content: str) -> Message:
    """`std_msgs/String` at `t`, s."""
    return message(t, topic, "std_msgs/String", Layout().text(content))


def json_text(t: float, topic: str, content: dict[str, Any]) -> Message:
    """`std_msgs/String` with JSON at `t`, s."""
    return text(t, topic, json.dumps(content, ensure_ascii=False))


def log_entry(leaf: LeafRun) -> Message:
    """`rcl_interfaces/Log` of the end of a leaf: stamp, level, name, text, and no source location."""
    content = ", ".join(filter(None, (f"{leaf.label}: {leaf.status}", leaf.message)))
    stamp = divmod(nanosecond(leaf.end), 1_000_000_000)
    layout = Layout().uint32(*stamp).uint8(LEVELS[leaf.status])
    layout.text(leaf.node, content, "", "").uint32(0)
    return message(leaf.end, "/rosout", "rcl_interfaces/Log", layout)


def message(t: float, topic: str, datatype: str, layout: Layout) -> Message:
    """Message of a `layout` without open fields, at `t`, s."""
    return Message(nanosecond(t), topic, datatype, bytes(layout.constant))
