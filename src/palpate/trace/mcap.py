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
import struct
import zlib
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import IO, TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from palpate.common.errors import InputError
from palpate.common.files import open_with_limit
from palpate.common.redaction import redact
from palpate.common.version import __version__
from palpate.trace import topics
from palpate.trace.recording import Conversion, LeafRun, NominalHand, Recording
from palpate.trace.samples import COLUMNS, Samples, Trace
from palpate.trace.topics import definition, nanosecond, samples_of

if TYPE_CHECKING:
    from mcap.records import Channel, Chunk, ChunkIndex, McapRecord, Message, Schema
    from pydantic import ConfigDict, TypeAdapter


METADATA = "palpate.trace"
PROFILE = "palpate-stream"  # Profile in the file header of an unfinished run
BLOCKS, EVENTS = "/palpate/samples", "/palpate/events"
# s of robot time between two blocks: the largest loss when the process is killed.
BLOCK_SECONDS = 0.25
CHUNK_BYTES, BLOCK_ROWS = 1 << 20, 256  # Size of a written chunk; samples that are encoded at once
# Beginning of a message record; times in ns.
MESSAGE_HEAD = np.dtype([("constant", "V15"), ("log_time", "<u8"), ("publish_time", "<u8")])
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
    """Write `trace` to `path`, in zstd-compressed chunks, with the additional messages `shown`.

    Messages are in order of time. At equal times `shown` comes first, then samples, then events.
    """
    times = topics.nanoseconds(trace.samples.t)
    order = np.argsort(times, kind="stable")
    times, samples = times[order], trace.samples.where(order)
    # Single messages, each with the sample before which it stands.
    placed: list[tuple[int, topics.Message]] = []
    for single, shift in ((shown, 0), (topics.events(trace), 1)):
        places = np.searchsorted(times, np.array([one.time + shift for one in single], np.int64))
        placed += zip(places.tolist(), single, strict=True)
    placed.sort(key=lambda each: each[1].time)
    record = TraceRecord(
        trace.leaves, trace.recordings, trace.conversions, trace.hand, trace.gravity
    )
    with path.open("wb") as file:
        # The metadata record is in no chunk, so that only the checksum of all data covers it.
        writer = ChunkWriter(file)
        writer.add_metadata(METADATA, {"version": __version__, "trace": dump_record(record)})
        for first in range(0, len(times) + 1, BLOCK_ROWS):
            rows = slice(first, first + BLOCK_ROWS)
            block = topics.encode_samples(samples.where(rows), trace.hand)
            single = [
                (place - first, one) for place, one in placed if 0 <= place - first < BLOCK_ROWS
            ]
            writer.add_block(times[rows], block, single)
        writer.finish()


class ChunkWriter:
    """Writer of a chunked MCAP file that takes messages in blocks.

    The library's `Writer` takes them one by one, and needs 20 times the time. The records are the library's;
    only those of messages and of their index are made here, as numpy arrays.
    """

    def __init__(self, file: IO[bytes]) -> None:
        from mcap.records import Header
        from mcap.writer import MCAP0_MAGIC

        self._file, self._crc = file, 0
        self._schemas: dict[str, Schema] = {}
        self._channels: dict[str, Channel] = {}
        self._chunks: list[ChunkIndex] = []
        self._metadata: list[McapRecord] = []
        # Content of the chunk in progress, its size, and by channel the times and offsets (n, 2) of messages.
        self._parts: list[bytes] = []
        self._size = 0
        self._index: defaultdict[int, list[NDArray[np.uint64]]] = defaultdict(list)
        self._counts: defaultdict[int, int] = defaultdict(int)  # messages by channel
        self._put(MCAP0_MAGIC)
        self._put(encode_record(Header(profile="ros2", library=f"palpate {__version__}")))

    def add_metadata(self, name: str, content: dict[str, str]) -> None:
        """Write a metadata record."""
        from mcap.records import Metadata, MetadataIndex

        data = encode_record(Metadata(metadata=content, name=name))
        self._metadata.append(MetadataIndex(offset=self._put(data), length=len(data), name=name))

    def add_block(
        self,
        times: NDArray[np.int64],
        block: Mapping[str, tuple[str, NDArray[np.void]]],
        single: Sequence[tuple[int, topics.Message]],
    ) -> None:
        """Add a row of messages at each of `times` (n,), ns, and single messages, each before the row of its number.

        `block` has the datatype and the n messages of each topic.
        """
        # Declare the channels before the first message.
        ids = [self._channel(topic, datatype) for topic, (datatype, _) in block.items()]
        others = [self._channel(message.topic, message.datatype) for _, message in single]
        # Lay the records of all topics side by side, a row per time.
        kinds = [np.dtype([("head", MESSAGE_HEAD), ("data", m.dtype)]) for _, m in block.values()]
        rows = np.empty(len(times), [(str(i), kind) for i, kind in zip(ids, kinds, strict=True)])
        for i, (_, messages) in zip(ids, block.values(), strict=True):
            rows[str(i)]["data"] = messages
            head = rows[str(i)]["head"]
            fields = _message_head(messages.itemsize, i), times, times
            head["constant"], head["log_time"], head["publish_time"] = fields
        # Write the rows, and the single messages between them; each moves the rows behind it.
        offsets = self._size + rows.itemsize * np.arange(len(times))
        content, written = rows.tobytes(), 0
        for i, (row, message) in zip(others, single, strict=True):
            self._add(content[written : row * rows.itemsize])
            written = row * rows.itemsize
            self._index[i].append(np.array([[message.time, self._size]], "<u8"))
            time = message.time.to_bytes(8, "little")
            record = _message_head(len(message.data), i) + time + time + message.data
            offsets[row:] += len(record)
            self._add(record)
        self._add(content[written:])
        for i, kind in zip(ids, kinds, strict=True):
            self._index[i].append(np.column_stack([times, offsets]).astype("<u8"))
            offsets += kind.itemsize
        if self._size > CHUNK_BYTES:
            self._end_chunk()

    def finish(self) -> None:
        """Write the last chunk, the summary and the end of the file."""
        from mcap.opcode import Opcode
        from mcap.records import DataEnd, Footer, Statistics, SummaryOffset
        from mcap.writer import MCAP0_MAGIC

        self._end_chunk()
        self._put(encode_record(DataEnd(self._crc)))
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            message_end_time=max((chunk.message_end_time for chunk in self._chunks), default=0),
            message_start_time=min((chunk.message_start_time for chunk in self._chunks), default=0),
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )
        # The summary repeats schemas and channels, and tells where each group of records begins.
        groups: dict[Opcode, Iterable[McapRecord]] = {
            Opcode.SCHEMA: self._schemas.values(),
            Opcode.CHANNEL: self._channels.values(),
            Opcode.STATISTICS: [statistics],
            Opcode.CHUNK_INDEX: self._chunks,
            Opcode.METADATA_INDEX: self._metadata,
        }
        summary = self._file.tell()
        self._crc = 0
        offsets: list[bytes] = []
        for opcode, group in groups.items():
            data = b"".join(map(encode_record, group))
            start = self._put(data)
            offset = SummaryOffset(group_opcode=opcode, group_start=start, group_length=len(data))
            offsets.append(encode_record(offset))
        # The checksum of the summary covers the footer up to the checksum.
        there = self._put(b"".join(offsets))
        open_footer = encode_record(
            Footer(summary_crc=0, summary_offset_start=there, summary_start=summary)
        )
        crc = zlib.crc32(open_footer[:-4], self._crc)
        self._put(open_footer[:-4] + crc.to_bytes(4, "little") + MCAP0_MAGIC)

    def _channel(self, topic: str, datatype: str) -> int:
        """Return the channel of a topic, declared before its first message."""
        from mcap.records import Channel, Schema

        if datatype not in self._schemas:
            name, text = datatype.replace("/", "/msg/"), definition(datatype).encode()
            schema = Schema(data=text, encoding="ros2msg", id=len(self._schemas) + 1, name=name)
            self._schemas[datatype] = schema
            self._add(encode_record(schema))
        if topic not in self._channels:
            number, schema = len(self._channels) + 1, self._schemas[datatype].id
            channel = Channel(
                id=number, message_encoding="cdr", metadata={}, schema_id=schema, topic=topic
            )
            self._channels[topic] = channel
            self._add(encode_record(channel))
        return self._channels[topic].id

    def _end_chunk(self) -> None:
        """Write the chunk in progress, compressed, and the index of its messages by channel."""
        import zstandard
        from mcap.records import Chunk, ChunkIndex

        content = b"".join(self._parts)
        entries = {i: np.concatenate(found) for i, found in self._index.items()}
        times = np.concatenate([np.empty(0, "<u8"), *(found[:, 0] for found in entries.values())])
        if not len(times):
            return
        first, last = int(times.min()), int(times.max())
        packed = zstandard.compress(content)
        record = encode_record(
            Chunk(
                compression="zstd",
                data=packed,
                message_end_time=last,
                message_start_time=first,
                uncompressed_crc=zlib.crc32(content),
                uncompressed_size=len(content),
            )
        )
        start, offsets = self._put(record), dict[int, int]()
        for i, found in entries.items():
            # A record of the index: opcode 7, length, channel, bytes of the entries, entries.
            head = struct.pack("<BQHI", 7, 6 + found.nbytes, i, found.nbytes)
            offsets[i] = self._put(head + found.tobytes())
            self._counts[i] += len(found)
        self._chunks.append(
            ChunkIndex(
                chunk_length=len(record),
                chunk_start_offset=start,
                compression="zstd",
                compressed_size=len(packed),
                message_end_time=last,
                message_index_length=self._file.tell() - start - len(record),
                message_index_offsets=offsets,
                message_start_time=first,
                uncompressed_size=len(content),
            )
        )
        self._parts, self._size = [], 0
        self._index.clear()

    def _add(self, data: bytes) -> None:
        self._parts.append(data)
        self._size += len(data)

    def _put(self, data: bytes) -> int:
        """Append to the file; return the offset of the data in it."""
        start = self._file.tell()
        self._crc = zlib.crc32(data, self._crc)
        self._file.write(data)
        return start


def _message_head(size: int, channel: int) -> bytes:
    """Constant beginning of a message record with `size` bytes of data: opcode 5, length, channel, sequence 0."""
    return struct.pack("<BQHI", 5, size + 22, channel, 0)


def encode_record(record: McapRecord) -> bytes:
    """Encode a record of the file."""
    from mcap.data_stream import RecordBuilder

    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


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
