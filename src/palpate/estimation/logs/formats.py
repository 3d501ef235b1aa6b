"""Recordings in ROS bags, MCAP and Parquet."""

from __future__ import annotations

import json
import re
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple, cast

import numpy as np

from palpate.common.errors import InputError, Unavailable, perhaps
from palpate.common.files import open_with_limit, read_text, require_regular
from palpate.common.pose import Array
from palpate.estimation.logs.columns import WIDEST, ColumnMap, Table, list_names
from palpate.trace.mcap import stored_messages, unpacked_zstd

MAX_BAG_BYTES = 4_000_000_000
MAX_MESSAGES = 4_000_000
MAX_MESSAGE = 8 << 20
"""Largest size, bytes, of a compressed message after unpacking."""
MAX_DEPTH = 4
"""Largest nesting of fields in a message."""
OF_JOINTS = re.compile(r"joint|state", re.IGNORECASE)
"""Topics and types of messages that may contain joint signals."""
OF_SENSORS = re.compile(r"joint|state|wrench|force|ft|pose|transform", re.IGNORECASE)
"""Topics and types of messages that may contain those, a wrench, or the pose of its sensor."""
PACKED = b"\x28\xb5\x2f\xfd"
"""Magic number of zstd data."""
Decoder = Callable[[bytes], Any]


class Raw(NamedTuple):
    """Message as recorded: topic, type, time in ns, data; encoding, and definition of its type."""

    topic: str
    datatype: str
    time: int
    data: bytes
    encoding: str
    schema: tuple[str, str]


@dataclass
class TopicMessages:
    """Messages of one layout on a topic: joint names by field, and rows of numbers."""

    names: dict[str, list[str]]
    rows: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])

    def table(self) -> Table:
        """Columns in the order of time; a bag stores messages in the order of arrival."""
        table = {
            name: np.array([row[name] for row in self.rows], dtype=float) for name in self.rows[0]
        }
        # Drop stamps that were not set, and use the bag's time without a header stamp.
        for name in [name for name in table if name.endswith("stamp_s")]:
            if (table[name] == 0.0).any():
                del table[name]  # not set
        bag_time = table.pop("bag_time_s")
        if "header.stamp_s" not in table:
            table["bag_time_s"] = bag_time
        order = np.argsort(table.get("header.stamp_s", bag_time), kind="stable")
        table = {name: values[order] for name, values in table.items()}
        # Split vectors into one column per joint.
        for name, joints in self.names.items():
            parts = table.pop(name).T
            table |= {f"{name}.{joint}": part for joint, part in zip(joints, parts, strict=True)}
        return table


def read_bag(
    path: Path, columns: ColumnMap, likely: re.Pattern[str] = OF_JOINTS
) -> tuple[list[tuple[str, Table]], list[str]]:
    """Read the signals of each topic that is `likely` to have them, or of `columns.topic`.

    Returns:
        A table for each layout of a topic's messages, the longest first, and notes on undecodable messages.

    Raises:
        InputError: The file is no bag, is damaged, or has no topic with joint states.
        Unavailable: `rosbags` is not installed.
    """
    try:
        import rosbags  # noqa: F401  # pyright: ignore
    except ImportError:
        raise Unavailable(f"{path}: a bag needs rosbags: pip install 'palpate[logs]'") from None
    with ExitStack() as stack:
        parts, topics, lost = _collect(_messages(path, stack), columns.topic, likely)
    notes = [
        f"{count} messages on {topic} ({topics[topic]}) cannot be decoded and are left out: {reason}"
        for topic, (count, reason) in lost.items()
    ]
    # Check that the stated topic exists, and that some topic has joint states.
    if columns.topic is not None and columns.topic not in topics:
        raise InputError(
            f"{path}: no topic '{columns.topic}';{perhaps(columns.topic, topics)} topics: "
            f"{list_names(sorted(topics))}"
        )
    if not parts:
        every = list_names(f"{topic} ({datatype})" for topic, datatype in sorted(topics.items()))
        raise InputError(
            f"{path}: no topic with joint states or a wrench{': ' * bool(notes)}{'; '.join(notes)}. Topics: {every}; "
            "state one in a file with 'topic: NAME', and give it as columns=MAP.yaml"
        )
    tables = [(topic, part.table()) for (topic, _), part in parts.items()]
    return sorted(tables, key=lambda one: -max(map(len, one[1].values()))), notes


def _collect(
    messages: Iterator[Raw], wanted: str | None, pattern: re.Pattern[str]
) -> tuple[dict[Any, TopicMessages], dict[str, str], dict[str, tuple[int, str]]]:
    """Decode the messages on the `wanted` topic, or all that may contain joint signals.

    Returns:
        Messages by topic and layout; types by topic; and by topic the number of undecodable messages, with the
        first reason.
    """
    parts: dict[Any, TopicMessages] = {}
    topics: dict[str, str] = {}
    lost: dict[str, tuple[int, str]] = {}
    decoders: dict[str, Decoder] = {}
    for count, raw in enumerate(messages):
        topics[raw.topic] = raw.datatype
        likely = raw.encoding == "json" or pattern.search(raw.topic + raw.datatype)
        if raw.topic != wanted if wanted else not likely:
            continue
        if count > MAX_MESSAGES:
            raise InputError(f"the bag has more than {MAX_MESSAGES} messages; cut it")
        # Unpack and decode; a failure counts as lost and is reported once per topic.
        try:
            if raw.topic not in decoders:
                decoders[raw.topic] = _refuse  # once, where the next line fails
                decoders[raw.topic] = _decoder(raw)
            is_packed = raw.data[:4] == PACKED
            data = unpacked_zstd(raw.data, MAX_MESSAGE) if is_packed else raw.data
            found = list(_numbers(_fields(decoders[raw.topic](data)) or {}))
        except Exception as error:  # damaged bytes raise anything
            count_lost, reason = lost.get(raw.topic, (0, _reason(error)))
            lost[raw.topic] = count_lost + 1, reason
            continue
        # Messages of the same fields and joints form one table; reorder joints to its first message.
        layout = tuple((name, frozenset(joints) or np.size(value)) for name, joints, value in found)
        names = {name: joints for name, joints, _ in found if joints}
        part = parts.setdefault((raw.topic, layout), TopicMessages(names))
        row: dict[str, Any] = {"bag_time_s": 1e-9 * raw.time}
        for name, joints, value in found:
            same = not joints or joints == part.names[name]
            row[name] = value if same else value[[joints.index(one) for one in part.names[name]]]
        part.rows.append(row)
    return parts, topics, lost


def _reason(error: Exception) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__


def _refuse(_: bytes) -> Any:
    raise ValueError("its type is not known")


def _decoder(raw: Raw) -> Decoder:
    """Build the decoder of a topic's messages.

    Raises ValueError: the encoding or a type definition cannot be read; rosbags raises other errors.
    """
    if raw.encoding == "json":
        return partial(json.loads, object_hook=lambda fields: SimpleNamespace(**fields))
    from rosbags import typesys  # pyright: ignore[reportMissingModuleSource]

    # Register the type definitions of the bag for the decoder.
    form, definition = raw.schema
    if raw.encoding not in ("cdr", "ros1") or form not in ("ros2msg", "ros1msg", "ros2idl", ""):
        raise ValueError(f"unknown encoding '{raw.encoding}' ('{form}'), not cdr, ros1 or json")
    datatype = re.sub("^([^/]+)/([^/]+)$", r"\1/msg/\2", raw.datatype)
    # Older databases contain no type definitions.
    store = typesys.get_typestore(typesys.Stores.EMPTY if form else typesys.Stores.LATEST)
    if form == "ros2idl":
        for text in filter(str.strip, re.split(r"={80}\nIDL: .*\n", definition)):
            store.register(typesys.get_types_from_idl(text))
    elif form:
        store.register(typesys.get_types_from_msg(definition, datatype))
    if datatype not in store.fielddefs:
        raise ValueError("its type is not defined in the bag")
    decode = store.deserialize_ros1 if raw.encoding == "ros1" else store.deserialize_cdr
    return lambda data: decode(data, datatype)


def _fields(message: Any) -> dict[str, Any] | None:
    """Fields of a message, or lists of the fields of a list of messages; None for other values."""
    each: list[Any] = cast("list[Any]", message) if isinstance(message, list) else []
    first: dict[str, Any] | None = getattr(each[0], "__dict__", None) if each else None
    if first is not None:
        return {name: [getattr(one, name, None) for one in each] for name in first}
    return getattr(cast("object", message), "__dict__", None)


def _numbers(
    message: dict[str, Any], path: str = "", depth: int = 0
) -> Iterator[tuple[str, list[str], Any]]:
    """Yield the numeric fields of a message: path, joint names, numbers; a stamp is in s."""
    # A time stamp of two fields becomes seconds; stamps nested more deeply are skipped.
    fine = {"nanosec", "nsec"} & message.keys()
    if "sec" in message and fine:
        if path.count(".") < 2:
            yield f"{path}_s", [], message["sec"] + 1e-9 * message[fine.pop()]
        return
    names: list[str] = list(message.get("name", ()))
    for name, value in message.items():
        place, inner = f"{path}.{name}".strip("."), _fields(value)
        if inner is not None:
            yield from _numbers(inner, place, depth + 1) if depth < MAX_DEPTH else ()
        elif np.isscalar(value) or np.ndim(value) == 1:
            numbers: Array = np.asarray(value)
            if numbers.dtype.kind in "fiu" and 0 < numbers.size <= WIDEST:
                named = numbers.ndim and len(set(names)) == len(names) == numbers.size
                yield place, names if named else [], numbers


def _messages(path: Path, stack: ExitStack) -> Iterator[Raw]:
    """Yield the messages of a bag's files in the stored order."""
    files = [path]
    if path.is_dir():
        files = sorted(file for kind in STORED for file in path.glob(f"*{kind}"))
    for file in files:
        require_regular(file, MAX_BAG_BYTES, "a bag")
        # Damaged files raise arbitrary errors, which become one error on the file.
        try:
            plain = file
            if file.suffix == ".zstd":
                plain = _unpacked(file, Path(stack.enter_context(tempfile.TemporaryDirectory())))
            yield from (_in_mcap if plain.suffix.lower() == ".mcap" else _in_others)(plain)
        except (InputError, Unavailable):
            raise
        except Exception as error:  # damaged bytes raise anything
            raise InputError(f"{file} is no bag that can be read: {_reason(error)}") from error


def _unpacked(path: Path, folder: Path) -> Path:
    """Decompress a file into a folder, up to the largest size of a bag."""
    import zstandard

    unpacked, left = folder / path.stem, MAX_BAG_BYTES
    with open_with_limit(path, MAX_BAG_BYTES, "a bag") as file, unpacked.open("wb") as out:
        for block in zstandard.ZstdDecompressor().read_to_iter(file):
            left -= len(block)
            if left < 0:
                raise InputError(f"{path} unpacks to more than {MAX_BAG_BYTES // 10**6} MB")
            out.write(block)
    return unpacked


def _in_mcap(path: Path) -> Iterator[Raw]:
    """Yield the messages of one MCAP file, with bounded memory."""
    with open_with_limit(path, MAX_BAG_BYTES, "a recording in MCAP") as file:
        for schema, channel, message in stored_messages(file):
            name, form = ("", ("", ""))
            if schema is not None:
                name, form = schema.name, (schema.encoding, schema.data.decode("utf-8", "replace"))
            yield Raw(
                channel.topic, name, message.log_time, message.data, channel.message_encoding, form
            )


def _in_others(path: Path) -> Iterator[Raw]:
    """Yield the messages of a rosbag2 database or a ROS 1 bag."""
    from rosbags import rosbag1, rosbag2  # pyright: ignore[reportMissingModuleSource]
    from rosbags.interfaces import MessageDefinitionFormat  # pyright: ignore[reportMissingModuleSource]

    forms = {MessageDefinitionFormat.MSG: "ros2msg", MessageDefinitionFormat.IDL: "ros2idl"}
    with (rosbag1 if path.suffix == ".bag" else rosbag2).Reader(path) as reader:
        for connection, time, data in reader.messages():
            encoding = getattr(connection.ext, "serialization_format", "ros1")
            schema = forms.get(connection.msgdef.format, ""), connection.msgdef.data
            yield Raw(connection.topic, connection.msgtype, time, data, encoding, schema)


STORED = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd")
"""File name endings in a rosbag2 folder."""


# Tables in Parquet, such as the episodes of a LeRobot data set


MAX_PARQUET_BYTES = 1_000_000_000
EPISODE = "episode_index"
INFO = "meta/info.json"
"""Description of the columns of a LeRobot data set, next to the folder `data`."""


def read_parquet(path: Path, columns: ColumnMap) -> Table:
    """Read numeric columns, and columns of lists of equal length; one episode of a LeRobot file.

    Raises:
        InputError: The file does not exist, is too large, or has several episodes and none is stated.
        Unavailable: `pyarrow` is not installed.
    """
    try:
        import pyarrow.parquet as parquet  # pyright: ignore[reportMissingModuleSource]
    except ImportError:
        raise Unavailable(f"{path}: Parquet needs pyarrow: pip install 'palpate[logs]'") from None
    # Bound the unpacked size before the content is read.
    require_regular(path, MAX_PARQUET_BYTES, "a recording of an arm")
    try:
        file: Any = parquet.ParquetFile(path)
        groups = range(file.metadata.num_row_groups)
        if sum(file.metadata.row_group(i).total_byte_size for i in groups) > MAX_PARQUET_BYTES:
            raise InputError(f"{path} unpacks to more than {MAX_PARQUET_BYTES // 10**6} MB; cut it")
        content: Any = file.read()
    except (OSError, ValueError) as error:
        raise InputError(f"{path} is no Parquet file: {str(error).splitlines()[0]}") from None
    # Keep columns that convert to numbers of one or two dimensions.
    found: dict[str, Any] = {}
    for name in content.column_names:
        values = content[name].to_pylist()
        try:
            numbers = np.array(values, dtype=float)
        except (TypeError, ValueError):
            continue  # texts, pictures, lists of different lengths
        if numbers.ndim in (1, 2):
            found[name] = numbers
    return _split_named_columns(path, _episode(path, found, columns.episode))


def _episode(path: Path, table: dict[str, Any], wanted: int | None) -> dict[str, Any]:
    """Rows of one episode of a LeRobot table; other tables stay unchanged."""
    if EPISODE not in table:
        return table
    every = sorted({int(number) for number in table[EPISODE]})
    if wanted is None and len(every) > 1:
        raise InputError(
            f"{path} has episodes {every[0]} to {every[-1]}; state one in a file with 'episode: "
            f"{every[0]}', and give it as columns=MAP.yaml"
        )
    number = every[0] if wanted is None else wanted
    if number not in every:
        raise InputError(f"{path}: no episode {number}; it has {every[0]} to {every[-1]}")
    # Keep the rows of the episode.
    rows = table[EPISODE] == number
    return {name: values[rows] for name, values in table.items()}


def _split_named_columns(path: Path, table: dict[str, Any]) -> Table:
    """Split vector columns whose components a LeRobot data set names."""
    info = next((up / INFO for up in path.absolute().parents[:4] if (up / INFO).is_file()), None)
    if info is None:
        return table
    try:
        features: Any = json.loads(read_text(info, 1_000_000, "a data set's description"))[
            "features"
        ]
    except (ValueError, KeyError, TypeError):
        return table
    found = dict(table)
    for column, values in table.items():
        stated: Any = features.get(column, {}).get("names")
        # The names are a list, or a list under its own key: {"motors": [...]}.
        lists: Any = stated.values() if hasattr(stated, "values") else [stated]
        names: list[str] = next(iter(lists), None) or []
        if values.ndim == 2 and len({*names}) == len(names) == values.shape[1]:
            del found[column]
            found |= {f"{column}.{name}": part for name, part in zip(names, values.T, strict=True)}
    return found
