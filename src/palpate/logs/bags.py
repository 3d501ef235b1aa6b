"""ROS messages in bags: MCAP, rosbag2 (a folder or its database) and bags of ROS 1, decoded by `rosbags`.

A message becomes numbers by the path of its fields: `measured_joint_state.effort`. Joints of a
`sensor_msgs/JointState` stand in the order of their names' numbers, as its own order may be any; fingers are
left out.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from palpate.errors import InputError, Unavailable, perhaps
from palpate.files.read import opened, require_regular
from palpate.geometry.pose import Array
from palpate.logs.columns import ColumnMap, Table, guessed, listed
from palpate.trace.mcap import stored_messages

MAX_BYTES = 4_000_000_000
MAX_MESSAGES = 4_000_000
MAX_DEPTH = 4
"""Fields within fields of a message."""
OF_JOINTS = re.compile(r"joint_?state|franka_?(robot_?)?state", re.IGNORECASE)
"""Types of messages that hold joint signals."""


class Raw(NamedTuple):
    """Message as recorded: topic, type, time in ns, and a decoder of its bytes."""

    topic: str
    datatype: str
    time: int
    decode: Any


def read_bag(path: Path, columns: ColumnMap) -> Table:
    """Read the joint signals of one topic: of `columns.topic`, else of the one with most signals.

    Raises:
        InputError: no bag, damaged, or no topic of it has joint states.
        Unavailable: `rosbags` is not installed.
    """
    try:
        import rosbags.highlevel  # noqa: F401  # pyright: ignore
    except ImportError:
        raise Unavailable(f"{path}: a bag needs rosbags: pip install 'palpate[logs]'") from None
    try:
        tables, others = _tables(path, columns.topic)
    except (InputError, Unavailable):
        raise
    except Exception as error:  # damaged bytes raise anything
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError(f"{path} is no bag that can be read: {reason}") from error
    if columns.topic is not None and columns.topic not in tables:
        names = sorted({*tables, *others})
        raise InputError(
            f"{path}: no topic '{columns.topic}';{perhaps(columns.topic, names)} topics: {listed(names)}"
        )
    if not tables:
        every = listed(f"{topic} ({datatype})" for topic, datatype in sorted(others.items()))
        raise InputError(
            f"{path}: no topic with joint states. Topics: {every}; state one in a file with "
            "'topic: NAME', and give it as columns=MAP.yaml"
        )
    return max(tables.values(), key=lambda table: (len(guessed(table)), len(table["time"])))


def _tables(path: Path, wanted: str | None) -> tuple[dict[str, Table], dict[str, str]]:
    """Tables of the topics with joint signals, or of the one that is wanted; and types of the other topics."""
    rows: defaultdict[str, defaultdict[str, list[Any]]] = defaultdict(lambda: defaultdict(list))
    others: dict[str, str] = {}
    for count, raw in enumerate(_messages(path)):
        used = raw.topic == wanted if wanted is not None else bool(OF_JOINTS.search(raw.datatype))
        if not used:
            others[raw.topic] = raw.datatype
            continue
        if count > MAX_MESSAGES:
            raise InputError(f"{path} has more than {MAX_MESSAGES} messages; cut it")
        message = raw.decode()
        row = dict(_numbers(message, ""))
        row["time"] = row.get("header.stamp") or 1e-9 * raw.time
        row.pop("header.stamp", None)
        for name, value in row.items():
            rows[raw.topic][name].append(value)
    return {topic: _joined(every) for topic, every in rows.items()}, others


def _joined(rows: Mapping[str, list[Any]]) -> Table:
    """Columns that every message has, in one size, in the order of time: a bag is in that of its arrival."""
    count, order = len(rows["time"]), np.argsort(rows["time"], kind="stable")
    whole = {
        name: values
        for name, values in rows.items()
        if len(values) == count and len({np.shape(value) for value in values}) == 1
    }
    return {name: np.array(values, dtype=float)[order] for name, values in whole.items()}


def _numbers(message: Any, path: str, depth: int = 0) -> Iterator[tuple[str, float | Array]]:
    """Numeric fields of a message by their path; a stamp in s."""
    if depth > MAX_DEPTH:
        return
    names = [field.name for field in fields(message) if not field.name.startswith("__")]
    if {"sec", "nanosec"} <= set(names):
        yield path, message.sec + 1e-9 * message.nanosec
        return
    order = _order(message.name) if {"name", "position", "effort"} <= set(names) else None
    for name in names:
        value, place = getattr(message, name), f"{path}.{name}".strip(".")
        numbers: Array = np.asarray(value if np.isscalar(value) or np.ndim(value) == 1 else [])
        if is_dataclass(value):
            yield from _numbers(value, place, depth + 1)
        elif numbers.dtype.kind in "fiu" and numbers.size:
            yield place, numbers[order] if order is not None else numbers


def _order(names: list[str]) -> list[int]:
    """Places of an arm's joints in the order of their numbers."""
    found: list[tuple[int, int]] = []
    for place, name in enumerate(names):
        number = re.search(r"(\d+)\D*$", name)
        if number and "finger" not in name.lower():
            found.append((int(number[1]), place))
    return [place for _, place in sorted(found)]


def _messages(path: Path) -> Iterator[Raw]:
    """Messages of a bag, in the order that they are stored in."""
    parts = sorted(path.glob("*.mcap")) if path.is_dir() else [path]
    if parts and all(part.suffix == ".mcap" for part in parts):
        for part in parts:
            yield from _in_mcap(part)
        return
    # A database is read by way of the folder that describes it.
    folder = path.parent if path.suffix == ".db3" else path
    for file in folder.iterdir() if folder.is_dir() else [folder]:
        require_regular(file, MAX_BYTES, "a bag")
    from rosbags.highlevel import AnyReader  # pyright: ignore[reportMissingModuleSource]
    from rosbags.typesys import Stores, get_typestore  # pyright: ignore[reportMissingModuleSource]

    # Older databases hold no definitions of their types.
    standard = get_typestore(Stores.LATEST)
    with AnyReader([folder], default_typestore=standard) as reader:
        for connection, time, data in reader.messages():
            datatype = connection.msgtype

            def decode(data: bytes = data, datatype: str = datatype) -> Any:
                return reader.deserialize(data, datatype)

            yield Raw(connection.topic, datatype, time, decode)


def _in_mcap(path: Path) -> Iterator[Raw]:
    """Messages in one MCAP file, with bounded memory."""
    from rosbags import typesys  # pyright: ignore[reportMissingModuleSource]

    store = typesys.get_typestore(typesys.Stores.EMPTY)
    known: set[str] = set()
    with opened(path, MAX_BYTES, "a recording in MCAP") as file:
        for schema, channel, message in stored_messages(file):
            datatype = "" if schema is None else schema.name
            if schema is not None and datatype not in known and schema.encoding == "ros2msg":
                known.add(datatype)
                store.register(typesys.get_types_from_msg(schema.data.decode(), datatype))

            def decode(data: bytes = message.data, datatype: str = datatype) -> Any:
                return store.deserialize_cdr(data, datatype)

            yield Raw(channel.topic, datatype, message.log_time, decode)
