"""`trace.mcap`: the trace as ROS 2 messages, for Foxglove, PlotJuggler and Rerun, and back again.

Log time and stamps are robot time, from 0. Topics, one message per sample:

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

Events: `/leaves`, `/recordings` and `/conversions` (String, JSON) and `/rosout` (Log). The metadata
record `palpate.trace` holds the leaves, recordings, conversions, hand and gravity, so that
`read_mcap` returns the very trace that was written.
"""

from __future__ import annotations

import heapq
import json
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate import __version__
from palpate.errors import InputError
from palpate.trace.recording import Conversion, Hand, LeafRun, Recording
from palpate.trace.ros2_messages import definition
from palpate.trace.samples import Samples, Trace

if TYPE_CHECKING:
    from palpate.geometry.pose import Array

METADATA = "palpate.trace"
MAX_BYTES = 1 << 30
"""A file larger than this is not read; an hour of samples has a tenth of it."""

MAX_RECORD = 64 << 20
"""A record that claims more bytes is damaged; chunks are cut at 1 MiB."""

WORLD, TCP, TCP_WORLD_AXES = "world", "tcp", "tcp_world_axes"


@dataclass(frozen=True, slots=True)
class _Message:
    t: float
    topic: str
    datatype: str
    content: dict[str, Any]


@dataclass(frozen=True, slots=True)
class _Record:
    """All of a `Trace` but its samples."""

    leaves: tuple[LeafRun, ...]
    recordings: tuple[Recording, ...]
    conversions: tuple[Conversion, ...]
    hand: Hand
    gravity: float


def write_mcap(path: Path, trace: Trace) -> None:
    """Write `trace` to `path`, in zstd-compressed chunks."""
    from mcap_ros2.writer import Writer
    from pydantic import TypeAdapter

    record = _Record(trace.leaves, trace.recordings, trace.conversions, trace.hand, trace.gravity)
    with path.open("wb") as file, Writer(file) as writer:
        writer.add_metadata(
            METADATA,
            {"version": __version__, "trace": TypeAdapter(_Record).dump_json(record).decode()},
        )
        schemas: dict[str, Any] = {}
        for message in heapq.merge(_samples(trace), _events(trace), key=lambda m: m.t):
            if message.datatype not in schemas:
                package, name = message.datatype.split("/")
                schemas[message.datatype] = writer.register_msgdef(
                    f"{package}/msg/{name}", definition(message.datatype)
                )
            writer.write_message(
                message.topic,
                schemas[message.datatype],
                message.content,
                log_time=_nanoseconds(message.t),
            )


def read_mcap(path: Path) -> Trace:
    """The trace that `write_mcap` wrote.

    Raises:
        InputError: not such a file.
    """
    from mcap.reader import SeekingReader
    from mcap_ros2.decoder import DecoderFactory
    from pydantic import TypeAdapter

    if not path.is_file():
        raise InputError(f"no trace at '{path}'")
    if path.stat().st_size > MAX_BYTES:
        raise InputError(f"'{path}' is larger than {MAX_BYTES >> 20} MiB, no trace of palpate's is")
    try:
        with path.open("rb") as file:
            reader = SeekingReader(
                file,
                validate_crcs=True,
                decoder_factories=[DecoderFactory()],
                record_size_limit=MAX_RECORD,
            )
            metadata = {m.name: m.metadata for m in reader.iter_metadata()}
            record = TypeAdapter(_Record).validate_json(metadata[METADATA]["trace"])
            samples = _read_samples(reader.iter_decoded_messages(topics=list(_COLUMNS)))
    except (
        Exception
    ) as error:  # on damaged bytes the decoders raise anything from struct.error to NameError
        raise InputError(
            f"'{path}' is not a trace written by palpate: {_first_line(error)}"
        ) from error
    return Trace(
        samples, record.leaves, record.recordings, record.conversions, record.hand, record.gravity
    )


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]


def _samples(trace: Trace) -> Iterator[_Message]:
    """Nine messages per sample, in order of time."""
    samples = trace.samples
    joints, fingers = list(trace.hand.joints), list(trace.hand.fingers)
    rows = [
        samples.t,
        samples.q,
        samples.dq,
        samples.tau_ext,
        samples.wrench,
        samples.pose_world_tcp,
        samples.twist,
        samples.target_world_tcp,
        samples.width,
    ]
    for t, q, dq, tau, wrench, pose, twist, target, width in zip(
        *(a.tolist() for a in rows), strict=True
    ):
        stamp = _stamp(t)
        world, tcp = (
            {"stamp": stamp, "frame_id": WORLD},
            {"stamp": stamp, "frame_id": TCP_WORLD_AXES},
        )
        yield _Message(t, "/robot_time", "std_msgs/Float64", {"data": t})
        yield _Message(
            t,
            "/joint_states",
            "sensor_msgs/JointState",
            _joints(world, joints, position=q, velocity=dq),
        )
        yield _Message(
            t,
            "/gripper/joint_states",
            "sensor_msgs/JointState",
            _joints(world, fingers, position=[width / 2, width / 2]),
        )
        yield _Message(
            t,
            "/external_joint_torques",
            "sensor_msgs/JointState",
            _joints(world, joints, effort=tau),
        )
        yield _Message(
            t,
            "/wrench",
            "geometry_msgs/WrenchStamped",
            {
                "header": tcp,
                "wrench": {"force": _vector(wrench[:3]), "torque": _vector(wrench[3:])},
            },
        )
        yield _Message(
            t, "/tcp_pose", "geometry_msgs/PoseStamped", {"header": world, "pose": _pose(pose)}
        )
        yield _Message(
            t, "/tcp_target", "geometry_msgs/PoseStamped", {"header": world, "pose": _pose(target)}
        )
        yield _Message(
            t,
            "/tcp_twist",
            "geometry_msgs/TwistStamped",
            {"header": tcp, "twist": {"linear": _vector(twist[:3]), "angular": _vector(twist[3:])}},
        )
        yield _Message(
            t,
            "/tf",
            "tf2_msgs/TFMessage",
            {
                "transforms": [
                    _transform(world, TCP, pose),
                    _transform(world, TCP_WORLD_AXES, [*pose[:3], 1.0, 0.0, 0.0, 0.0]),
                ]
            },
        )


def _events(trace: Trace) -> list[_Message]:
    """Beginnings and ends of leaves and recordings, and conversions, in order of time."""
    messages: list[_Message] = []
    for leaf in trace.leaves:
        about = {"node": leaf.node, "primitive": leaf.primitive, "label": leaf.label}
        messages.append(_json(leaf.start, "/leaves", {**about, "event": "start"}))
        messages.append(
            _json(leaf.end, "/leaves", {**about, "event": leaf.status, "message": leaf.message})
        )
        messages.append(_log(leaf))
    for recording in trace.recordings:
        messages.append(
            _json(recording.start, "/recordings", {"event": "start", **asdict(recording)})
        )
        messages.append(_json(recording.end, "/recordings", {"event": "end", **asdict(recording)}))
    messages += [_json(c.time, "/conversions", asdict(c)) for c in trace.conversions]
    return sorted(messages, key=lambda m: m.t)


def _json(t: float, topic: str, content: dict[str, Any]) -> _Message:
    return _Message(t, topic, "std_msgs/String", {"data": json.dumps(content, ensure_ascii=False)})


def _log(leaf: LeafRun) -> _Message:
    level = 20 if leaf.status == "SUCCESS" else 40 if leaf.status == "FAILURE" else 30
    text = f"{leaf.label}: {leaf.status}" + (f", {leaf.message}" if leaf.message else "")
    return _Message(
        leaf.end,
        "/rosout",
        "rcl_interfaces/Log",
        {
            "stamp": _stamp(leaf.end),
            "level": level,
            "name": leaf.node,
            "msg": text,
            "file": "",
            "function": "",
            "line": 0,
        },
    )


def _joints(header: dict[str, Any], names: list[str], **columns: list[float]) -> dict[str, Any]:
    return {
        "header": header,
        "name": names,
        "position": [],
        "velocity": [],
        "effort": [],
        **columns,
    }


def _vector(xyz: list[float]) -> dict[str, float]:
    return dict(zip("xyz", xyz, strict=True))


def _quaternion(wxyz: list[float]) -> dict[str, float]:
    return dict(zip("wxyz", wxyz, strict=True))


def _pose(pose: list[float]) -> dict[str, Any]:
    return {"position": _vector(pose[:3]), "orientation": _quaternion(pose[3:])}


def _transform(header: dict[str, Any], child: str, pose: list[float]) -> dict[str, Any]:
    return {
        "header": header,
        "child_frame_id": child,
        "transform": {"translation": _vector(pose[:3]), "rotation": _quaternion(pose[3:])},
    }


def _nanoseconds(t: float) -> int:
    return max(0, round(t * 1e9))


def _stamp(t: float) -> dict[str, int]:
    seconds, nanoseconds = divmod(_nanoseconds(t), 1_000_000_000)
    return {"sec": seconds, "nanosec": nanoseconds}


def _of_vector(v: Any) -> list[float]:
    return [v.x, v.y, v.z]


def _of_pose(p: Any) -> list[float]:
    q = p.orientation
    return [*_of_vector(p.position), q.w, q.x, q.y, q.z]


_COLUMNS: dict[str, Callable[[Any], dict[str, Any]]] = {
    "/robot_time": lambda m: {"t": m.data},
    "/joint_states": lambda m: {"q": m.position, "dq": m.velocity},
    "/gripper/joint_states": lambda m: {"width": sum(m.position)},
    "/external_joint_torques": lambda m: {"tau_ext": m.effort},
    "/wrench": lambda m: {"wrench": _of_vector(m.wrench.force) + _of_vector(m.wrench.torque)},
    "/tcp_pose": lambda m: {"pose_world_tcp": _of_pose(m.pose)},
    "/tcp_target": lambda m: {"target_world_tcp": _of_pose(m.pose)},
    "/tcp_twist": lambda m: {"twist": _of_vector(m.twist.linear) + _of_vector(m.twist.angular)},
}
"""How each topic's message gives back columns of `Samples`."""


def _read_samples(messages: Iterable[Any]) -> Samples:
    """Raises ValueError when a topic lacks rows."""
    columns: dict[str, list[Any]] = defaultdict(list)
    for message in messages:
        for name, value in _COLUMNS[message.channel.topic](message.decoded_message).items():
            columns[name].append(value)
    if not columns:
        return Samples.empty()
    arrays: dict[str, Array] = {name: np.array(rows, dtype=float) for name, rows in columns.items()}
    shapes = {
        name: (len(arrays["t"]), *empty.shape[1:])
        for name, empty in asdict(Samples.empty()).items()
    }
    wrong = [
        name for name, shape in shapes.items() if name not in arrays or arrays[name].shape != shape
    ]
    if wrong:
        raise ValueError(f"{', '.join(wrong)} lacks samples")
    return Samples(**arrays)
