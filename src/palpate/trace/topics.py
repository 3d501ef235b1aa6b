"""The topics of `trace.mcap`: ROS 2 messages made of samples and events, and samples made of
messages.

Log time and stamps are robot time, from 0. One message per sample:

| topic | message | content |
|---|---|---|
| `/joint_states` | JointState | joints 1–7: position rad, velocity rad/s |
| `/gripper/joint_states` | JointState | both fingers: position m, half the opening each |
| `/external_joint_torques` | JointState | joints 1–7: effort N m, measured less nominal gravity and
friction |
| `/wrench` | WrenchStamped | what the hand exerts on the outside, about the TCP: frame
`tcp_world_axes` |
| `/tcp_pose`, `/tcp_target` | PoseStamped | TCP measured and commanded, in `world` |
| `/tcp_twist` | TwistStamped | TCP velocity, in world axes: frame `tcp_world_axes` |
| `/tf` | TFMessage | `world` → `tcp`, and `world` → `tcp_world_axes` (at the TCP, turned like the
world) |
| `/robot_time` | Float64 | robot time in s, to the last bit |

Events: `/step` (String, what begins), `/leaves`, `/recordings` and `/conversions` (String, JSON) and
`/rosout` (Log). What viewers are shown beside them is in `palpate.runs.shown`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.geometry.pose import Array
from palpate.trace.cdr import Layout
from palpate.trace.recording import Hand, LeafRun
from palpate.trace.samples import Samples, Trace

WORLD, TCP, TCP_WORLD_AXES = "world", "tcp", "tcp_world_axes"

INFO, WARN, ERROR = 20, 30, 40
"""Levels of `rcl_interfaces/Log`."""

LEVELS = {"SUCCESS": INFO, "INVALID": WARN, "FAILURE": ERROR}


class Message(NamedTuple):
    """Message; `time` in ns."""

    time: int
    topic: str
    datatype: str
    data: bytes


class Topic(NamedTuple):
    """The messages of one topic, a row of the samples each."""

    datatype: str
    layout: Layout


def header(frame: str) -> Layout:
    """Header of most messages; `stamp` is open."""
    return Layout().time("stamp").text(frame)


def _transforms() -> Layout:
    """`world` → `tcp` and `world` → `tcp_world_axes`, which moves along but never turns."""
    both = Layout().uint32(2)
    both.time("stamp").text(WORLD, TCP)
    both.doubles("position", 3).doubles("orientation", 4)
    both.time("stamp").text(WORLD, TCP_WORLD_AXES)
    return both.doubles("position", 3).doubles("unturned", 4)


def topics(hand: Hand) -> dict[str, Topic]:
    """All topics of samples, with the joints named as `hand` says."""
    return {
        "/robot_time": Topic("std_msgs/Float64", Layout().doubles("t", 1)),
        "/joint_states": Topic(
            "sensor_msgs/JointState",
            header(WORLD).texts(hand.joints).array("q", 7).array("dq", 7).empty_array(),
        ),
        "/gripper/joint_states": Topic(
            "sensor_msgs/JointState",
            header(WORLD).texts(hand.fingers).array("fingers", 2).empty_array().empty_array(),
        ),
        "/external_joint_torques": Topic(
            "sensor_msgs/JointState",
            header(WORLD).texts(hand.joints).empty_array().empty_array().array("tau_ext", 7),
        ),
        "/wrench": Topic(
            "geometry_msgs/WrenchStamped",
            header(TCP_WORLD_AXES).doubles("wrench", 6),
        ),
        "/tcp_pose": Topic(
            "geometry_msgs/PoseStamped",
            header(WORLD).doubles("position", 3).doubles("orientation", 4),
        ),
        "/tcp_target": Topic(
            "geometry_msgs/PoseStamped",
            header(WORLD).doubles("target_position", 3).doubles("target_orientation", 4),
        ),
        "/tcp_twist": Topic(
            "geometry_msgs/TwistStamped",
            header(TCP_WORLD_AXES).doubles("twist", 6),
        ),
        "/tf": Topic("tf2_msgs/TFMessage", _transforms()),
    }


def messages(trace: Trace, shown: Sequence[Message] = ()) -> list[Message]:
    """All messages of a trace in order of time; at one instant, what is `shown` beside it first, then
    samples, then events."""
    everything = [*shown, *_sampled(trace), *_events(trace)]
    return sorted(everything, key=lambda message: message.time)


def samples_of(messages: Mapping[str, Sequence[bytes]], hand: Hand) -> Samples:
    """The samples whose messages stand in `messages`, by topic.

    Raises:
        ValueError: a topic lacks rows, or a message has another size.
    """
    signals: dict[str, NDArray[Any]] = {}
    for name, topic in topics(hand).items():
        signals |= topic.layout.decode(messages.get(name, ()))
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


def _sampled(trace: Trace) -> Iterator[Message]:
    """Nine messages per sample, topic by topic."""
    signals, times = _signals(trace.samples), nanoseconds(trace.samples.t).tolist()
    for name, topic in topics(trace.hand).items():
        encoded = topic.layout.encode(signals, len(times))
        for time, data in zip(times, encoded, strict=True):
            yield Message(time, name, topic.datatype, data)


def _signals(s: Samples) -> dict[str, NDArray[Any]]:
    """Values of the open fields of the layouts, a row per sample."""
    half = s.width / 2
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
        "fingers": np.column_stack([half, half]),
    }


def xyzw(pose: Array) -> Array:
    """The quaternions of poses (n, 7) in the order of ROS; ours begin with w."""
    return pose[:, [4, 5, 6, 3]]


def _pose(position: Array, turned: Array) -> Array:
    return np.column_stack([position, turned[:, [3, 0, 1, 2]]])


def stamps(t: Array) -> NDArray[np.int64]:
    """(n, 2) seconds and nanoseconds."""
    return np.column_stack(np.divmod(nanoseconds(t), 1_000_000_000))


def nanoseconds(t: Array) -> NDArray[np.int64]:
    """From s; times are numbers, and not negative, in MCAP."""
    return np.maximum(0, np.rint(np.nan_to_num(t) * 1e9)).astype(np.int64)


def _events(trace: Trace) -> list[Message]:
    """Beginnings and ends of leaves and recordings, and conversions."""
    events: list[Message] = []
    for leaf in trace.leaves:
        about = {"node": leaf.node, "primitive": leaf.primitive, "label": leaf.label}
        ended = {**about, "event": leaf.status, "message": leaf.message}
        events.append(text(leaf.start, "/step", leaf.label))
        events.append(_json(leaf.start, "/leaves", {**about, "event": "start"}))
        events.append(_json(leaf.end, "/leaves", ended))
        events.append(_log(leaf))
    for recording in trace.recordings:
        content = asdict(recording)
        events.append(_json(recording.start, "/recordings", {"event": "start", **content}))
        events.append(_json(recording.end, "/recordings", {"event": "end", **content}))
    for conversion in trace.conversions:
        events.append(_json(conversion.time, "/conversions", asdict(conversion)))
    return events


def _json(t: float, topic: str, content: dict[str, Any]) -> Message:
    return text(t, topic, json.dumps(content, ensure_ascii=False))


def text(t: float, topic: str, said: str) -> Message:
    """A text; t: s."""
    return message(t, topic, "std_msgs/String", Layout().text(said))


def _log(leaf: LeafRun) -> Message:
    """A leaf's end, for log panels: stamp, level, name, text, and no place in a source file."""
    said = f"{leaf.label}: {leaf.status}"
    if leaf.message:
        said += f", {leaf.message}"
    stamp = divmod(_nanosecond(leaf.end), 1_000_000_000)
    layout = Layout().uint32(*stamp).uint8(LEVELS[leaf.status])
    layout.text(leaf.node, said, "", "").uint32(0)
    return message(leaf.end, "/rosout", "rcl_interfaces/Log", layout)


def message(t: float, topic: str, datatype: str, layout: Layout) -> Message:
    """A message none of whose fields is left open; t: s."""
    return Message(_nanosecond(t), topic, datatype, bytes(layout.constant))


def _nanosecond(t: float) -> int:
    return max(0, round(t * 1e9)) if math.isfinite(t) else 0
