"""`trace.mcap`: the trace as ROS 2 messages (`palpate.trace.topics`), for Foxglove, PlotJuggler and
Rerun, and back again.

The metadata record `palpate.trace` holds the leaves, recordings, conversions, hand and gravity, so
that `read_mcap` returns the very trace that was written. The file of a run that was cut off
(`palpate.trace.stream`) is read as far as it goes.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING

from palpate import __version__
from palpate.errors import InputError
from palpate.files.read import opened
from palpate.redaction import redact
from palpate.trace.ros2_messages import definition
from palpate.trace.samples import Trace
from palpate.trace.stream import PROFILE, Record, read_stream
from palpate.trace.topics import Message, messages, samples_of
from palpate.trace.unpacked import records

if TYPE_CHECKING:
    from mcap.writer import Writer

METADATA = "palpate.trace"
MAX_BYTES = 1 << 30
"""A file larger than this is not read; an hour of samples has a tenth of it."""


def write_mcap(path: Path, trace: Trace, shown: Sequence[Message] = ()) -> None:
    """Write `trace` to `path`, in zstd-compressed chunks, with what else viewers are `shown`."""
    from mcap.writer import Writer
    from pydantic import TypeAdapter

    record = Record(trace.leaves, trace.recordings, trace.conversions, trace.hand, trace.gravity)
    content = redact(TypeAdapter(Record).dump_json(record).decode())
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library=f"palpate {__version__}")
        writer.add_metadata(METADATA, {"version": __version__, "trace": content})
        _write_messages(writer, messages(trace, shown))
        writer.finish()


def _write_messages(writer: Writer, messages: list[Message]) -> None:
    """Every datatype is declared once, and every topic, before its first message."""
    schemas: dict[str, int] = {}
    channels: dict[str, int] = {}
    for time, topic, datatype, data in messages:
        if datatype not in schemas:
            name = datatype.replace("/", "/msg/")
            text = definition(datatype).encode()
            schemas[datatype] = writer.register_schema(name, "ros2msg", text)
        if topic not in channels:
            channels[topic] = writer.register_channel(topic, "cdr", schemas[datatype])
        writer.add_message(channels[topic], time, data, publish_time=time)


def read_mcap(path: Path) -> Trace:
    """The trace that `write_mcap` wrote, or, as far as it goes, a `TraceStream`.

    Raises:
        InputError: not such a file.
    """
    if not path.exists():
        raise InputError(f"no trace at '{path}'")
    try:
        with opened(path, MAX_BYTES, "a trace of palpate's") as file:
            if _is_unfinished(file):
                return read_stream(file)
            return _read(file)
    except InputError:
        raise
    # On damaged bytes the reader raises anything from struct.error to NameError.
    except Exception as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError(f"'{path}' is not a trace written by palpate: {reason}") from error


def _read(file: IO[bytes]) -> Trace:
    from mcap.records import Channel, Message, Metadata
    from pydantic import TypeAdapter

    record: Record | None = None
    channels: dict[int, str] = {}
    by_topic: defaultdict[str, list[bytes]] = defaultdict(list)
    for found in records(file):
        if isinstance(found, Metadata) and found.name == METADATA:
            record = TypeAdapter(Record).validate_json(found.metadata["trace"])
        elif isinstance(found, Channel):
            channels[found.id] = found.topic
        elif isinstance(found, Message):
            by_topic[channels[found.channel_id]].append(found.data)
    if record is None:
        raise ValueError(f"there is no '{METADATA}' in it")
    return Trace(
        samples_of(by_topic, record.hand),
        record.leaves,
        record.recordings,
        record.conversions,
        record.hand,
        record.gravity,
    )


def _is_unfinished(file: IO[bytes]) -> bool:
    """True if it is the file of a run under way, by what its header says."""
    beginning = file.read(64)
    file.seek(0)
    return PROFILE.encode() in beginning
