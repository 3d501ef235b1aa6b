"""`trace.mcap`: the trace as ROS 2 messages (`palpate.trace.topics`), for Foxglove, PlotJuggler and Rerun,
and back.

`write_mcap` writes a finished trace. The metadata record `palpate.trace` holds leaves, recordings,
conversions, hand and gravity, so that `read_mcap` returns exactly the written trace.

`TraceStream` writes a trace while the robot moves. Encoding messages for viewers takes about as long as
the motion itself, too long for a loop at 50 Hz. The file of an unfinished run is therefore an MCAP of two
topics. One has blocks of numbers, a row per sample. The other has JSON of the leaves, recordings and
conversions that ended since the last block. A truncated file is read up to its end.
"""

from __future__ import annotations

import io
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import IO, TYPE_CHECKING, Protocol

import numpy as np

from palpate.common.errors import InputError
from palpate.common.files import open_with_limit
from palpate.common.redaction import redact
from palpate.common.version import __version__
from palpate.trace import topics
from palpate.trace.recording import Conversion, LeafRun, NominalHand, Recording
from palpate.trace.samples import COLUMNS, Samples, Trace
from palpate.trace.topics import definition, messages, nanosecond, samples_of

if TYPE_CHECKING:
    from mcap.records import Channel, Chunk, McapRecord, Message, Schema
    from pydantic import ConfigDict, TypeAdapter


METADATA = "palpate.trace"
PROFILE = "palpate-stream"  # Profile in the file header of an unfinished run
BLOCKS, EVENTS = "/palpate/samples", "/palpate/events"
# s of robot time between two blocks: the largest loss when the process is killed.
BLOCK_SECONDS = 0.25
MAX_BYTES = 1 << 30  # Largest size of a file that is read; an hour of samples has a tenth of it
MAX_RECORD = 64 << 20  # Bytes of one record in the file
MAX_CHUNK = 8 << 20  # Bytes of one unpacked chunk; palpate's chunks have 1 MiB
MAX_RATIO = 20  # Unpacked bytes per byte of the file, beyond one chunk; recorded signals have 4


@dataclass(frozen=True, slots=True)
class TraceRecord:
    """All parts of a `Trace` except its samples."""

    leaves: tuple[LeafRun, ...]
    recordings: tuple[Recording, ...]
    conversions: tuple[Conversion, ...]
    hand: NominalHand
    gravity: float


# NaN from a faulty sensor is written as the constant NaN and read back unchanged.
TraceRecord.__pydantic_config__: ConfigDict = {"ser_json_inf_nan": "constants"}  # type: ignore[attr-defined]


@cache
def record_json() -> TypeAdapter[TraceRecord]:
    """Return the converter between `TraceRecord` and JSON."""
    from pydantic import TypeAdapter  # slow to import

    return TypeAdapter(TraceRecord)


def dump_record(record: TraceRecord) -> str:
    """Return the JSON of a record, without keys of the environment."""
    return redact(record_json().dump_json(record).decode())


def write_mcap(path: Path, trace: Trace, shown: Sequence[topics.Message] = ()) -> None:
    """Write `trace` to `path`, in zstd-compressed chunks, with the additional messages `shown`."""
    from mcap.writer import Writer

    record = TraceRecord(
        trace.leaves, trace.recordings, trace.conversions, trace.hand, trace.gravity
    )
    schemas: dict[str, int] = {}
    channels: dict[str, int] = {}
    with path.open("wb") as file:
        # The metadata record is in no chunk, so that only the checksum of all data covers it.
        writer = Writer(file, enable_data_crcs=True)
        writer.start(profile="ros2", library=f"palpate {__version__}")
        writer.add_metadata(METADATA, {"version": __version__, "trace": dump_record(record)})
        for time, topic, datatype, data in messages(trace, shown):
            # MCAP wants datatype and topic declared before the first message.
            if datatype not in schemas:
                name, text = datatype.replace("/", "/msg/"), definition(datatype).encode()
                schemas[datatype] = writer.register_schema(name, "ros2msg", text)
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "cdr", schemas[datatype])
            writer.add_message(channels[topic], time, data, publish_time=time)
        writer.finish()


def read_mcap(path: Path) -> Trace:
    """Read the trace in a file of `write_mcap`, or, up to its end, in a file of `TraceStream`.

    Raises InputError: not such a file.
    """
    if not path.exists():
        raise InputError(f"no trace at '{path}'")
    try:
        with open_with_limit(path, MAX_BYTES, "a trace of palpate's") as file:
            return read(file)
    except InputError:
        raise
    # On damaged bytes the reader raises any exception from struct.error to NameError.
    except Exception as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError(f"'{path}' is not a trace written by palpate: {reason}") from error


def read(file: IO[bytes]) -> Trace:
    """Read the trace in a file."""
    from mcap.records import Channel, Message, Metadata

    is_stream = PROFILE.encode() in file.read(64)  # the header comes first
    parts: list[TraceRecord] = []
    blocks: list[Samples] = []
    topics: dict[int, str] = {}
    by_topic: defaultdict[str, list[bytes]] = defaultdict(list)
    # A stream has blocks and events; a finished file has one record and messages by topic.
    try:
        for found in records(file, finished=not is_stream):
            if isinstance(found, Metadata) and found.name == METADATA:
                parts = [record_json().validate_json(found.metadata["trace"])]
            elif isinstance(found, Channel):
                topics[found.id] = found.topic
            elif isinstance(found, Message) and topics[found.channel_id] == EVENTS:
                parts.append(record_json().validate_json(found.data))
            elif isinstance(found, Message) and topics[found.channel_id] == BLOCKS:
                blocks.append(samples_in_block(found.data, parts[0].hand))
            elif isinstance(found, Message):
                by_topic[topics[found.channel_id]].append(found.data)
    # At the end of a truncated stream, the reader raises any exception from EndOfFile to struct.error.
    except Exception:
        if not (is_stream and parts):
            raise
    if not parts:
        raise ValueError("it holds no record of a trace")
    # Join the parts; take hand and gravity from the first record.
    hand = parts[0].hand
    return Trace(
        Samples.concatenate(blocks) if is_stream else samples_of(by_topic, hand),
        tuple(leaf for part in parts for leaf in part.leaves),
        tuple(recording for part in parts for recording in part.recordings),
        tuple(conversion for part in parts for conversion in part.conversions),
        hand,
        parts[0].gravity,
    )


class GrowingRecorder(Protocol):
    """Recorder whose lists grow: all events that have ended so far, in order; and the nominal hand."""

    hand: NominalHand
    gravity: float
    leaves: list[LeafRun]
    recordings: list[Recording]
    conversions: list[Conversion]


class TraceStream:
    """Writer of a growing trace, block by block; it must be closed.

    Raises OSError: the disk is full or unavailable. Written data stays.
    """

    def __init__(self, path: Path, hand: NominalHand, gravity: float) -> None:
        from mcap.writer import Writer

        self._hand, self._gravity = hand, gravity
        self._pending: list[Samples] = []
        self._written = -np.inf
        self._recorded: GrowingRecorder | None = None
        self._seen = (0, 0, 0)
        self._file: IO[bytes] = path.open("wb")
        self._writer = Writer(self._file, use_chunking=False)
        self._writer.start(profile=PROFILE, library=f"palpate {__version__}")
        self._blocks = self._writer.register_channel(BLOCKS, "f64", 0)
        self._events = self._writer.register_channel(EVENTS, "json", 0)
        # Hand and gravity are on disk from the start: a file without samples is a valid trace.
        self._add_events(0.0, (), (), ())
        self._file.flush()

    def write(self, samples: Samples, recorded: GrowingRecorder) -> None:
        """Add new samples, and write a block if one is due."""
        if recorded is not self._recorded:
            self.flush()  # the last events of the previous attempt
            self._recorded, self._seen = recorded, (0, 0, 0)
        if len(samples):
            self._pending.append(samples)
        # `not <` instead of `>=`, so that a NaN time is written.
        if self._pending and not self._pending[-1].t[-1] - self._written < BLOCK_SECONDS:
            self.flush()

    def flush(self) -> None:
        """Write the pending samples as a block, and the events since the last one."""
        samples = Samples.concatenate(self._pending)
        self._pending = []
        # A block has one row per sample, all signals side by side.
        if len(samples):
            self._written = float(samples.t[-1])
            rows = np.column_stack([getattr(samples, signal.name) for signal in fields(samples)])
            self._add(self._blocks, self._written, rows.tobytes())
        # Only events that are new since the last block.
        if self._recorded is not None:
            # Lists only grow, so their lengths mark the written part.
            new, (a, b, c) = self._recorded, self._seen
            self._seen = (len(new.leaves), len(new.recordings), len(new.conversions))
            if self._seen != (a, b, c):
                events = new.leaves[a:], new.recordings[b:], new.conversions[c:]
                self._add_events(self._written, *events)
        self._file.flush()

    def close(self) -> None:
        """Write the rest, and close the file."""
        try:
            self.flush()
        finally:
            self._file.close()

    def _add_events(
        self,
        t: float,
        leaves: Sequence[LeafRun],
        recordings: Sequence[Recording],
        conversions: Sequence[Conversion],
    ) -> None:
        events = tuple(leaves), tuple(recordings), tuple(conversions)
        record = TraceRecord(*events, self._hand, self._gravity)
        self._add(self._events, t, dump_record(record).encode())

    def _add(self, channel: int, t: float, data: bytes) -> None:
        time = nanosecond(t)
        self._writer.add_message(channel, time, data, publish_time=time)


def samples_in_block(data: bytes, hand: NominalHand) -> Samples:
    """Decode the samples in a block, (n, m) numbers in the order of the fields of `Samples`."""
    # Split the columns of the block into signals; without a sensor its signal has no columns.
    names = [signal.name for signal in fields(Samples)]
    widths = {name: len(COLUMNS.get(name, "1")) for name in names}
    widths["wrench_sensor"] *= hand.wrench_sensor is not None
    ends = np.cumsum([*widths.values()])
    parts = np.split(np.frombuffer(data).reshape(-1, ends[-1]), ends[:-1], axis=1)
    signals = zip(names, parts, strict=True)
    return Samples(**{name: (p if name in COLUMNS else p[:, 0]).copy() for name, p in signals})


def records(file: IO[bytes], finished: bool = True) -> Iterator[McapRecord]:
    """Iterate over the records of a file in order, with chunks unpacked and bounded memory.

    Neither a record nor a chunk is unpacked beyond its bound, regardless of the size that the file claims. With
    `finished`, the checksums of a complete file are verified.
    Raises ValueError: unpacked, a chunk or all of them exceed their bounds.
    """
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader, breakup_chunk

    # Budget of unpacked bytes for the whole file.
    left = MAX_CHUNK + MAX_RATIO * file.seek(0, io.SEEK_END)
    file.seek(0)
    reader = StreamReader(
        file, emit_chunks=True, validate_crcs=finished, record_size_limit=MAX_RECORD
    )
    for record in reader.records:
        if not isinstance(record, Chunk):
            yield record
            continue
        # Unpack within the bounds, and iterate over the records inside.
        data = unpack_chunk(record, min(MAX_CHUNK, left))
        left -= len(data)
        yield from breakup_chunk(replace(record, compression="", data=data), validate_crc=finished)


def stored_messages(file: IO[bytes]) -> Iterator[tuple[Schema | None, Channel, Message]]:
    """Iterate over the messages of a complete file of any program, each with its channel and its schema."""
    from mcap.records import Channel, Message, Schema

    # Schemas and channels precede the messages that refer to them.
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    for record in records(file):
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            channels[record.id] = record
        elif isinstance(record, Message):
            channel = channels[record.channel_id]
            yield schemas.get(channel.schema_id), channel, record


def unpack_chunk(chunk: Chunk, most: int) -> bytes:
    """Unpack the content of a chunk.

    Raises ValueError: it has more than `most` bytes, or another compression than zstd or lz4.
    """
    import lz4.frame

    # One byte more than allowed shows an excess.
    match chunk.compression:
        case "":
            return chunk.data
        case "zstd":
            data = unpacked_zstd(chunk.data, most + 1)
        case "lz4":
            data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=most + 1)
        case other:
            raise ValueError(f"its chunks are packed with '{other[:20]}' instead of zstd or lz4")
    if len(data) > most:
        raise ValueError("it unpacks to more than recorded signals do")
    return data


def unpacked_zstd(data: bytes, most: int) -> bytes:
    """Unpack at most `most` bytes."""
    import zstandard

    # A bounded window limits the memory of the decompressor.
    unpacker = zstandard.ZstdDecompressor(max_window_size=MAX_CHUNK)
    with unpacker.stream_reader(data) as stream:
        return stream.read(most)
