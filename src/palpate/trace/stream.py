"""The trace as it grows, on disk while the robot moves.

What viewers show, a message a sample and topic, takes as long to make as the arm takes to move; a
loop at 50 Hz has no time for that. So the file of a run under way is an MCAP of two topics: blocks
of numbers, a row a sample, and what has ended since the last block (JSON). `write_mcap` puts the
finished file in its place. Cut off anywhere, it is read as far as it goes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import IO, TYPE_CHECKING, Protocol

import numpy as np

from palpate import __version__
from palpate.geometry.pose import Array
from palpate.redaction import redact
from palpate.trace.recording import Conversion, Hand, LeafRun, Recording
from palpate.trace.samples import COLUMNS, Samples, Trace
from palpate.trace.unpacked import records

if TYPE_CHECKING:
    from pydantic import ConfigDict

PROFILE = "palpate-stream"
"""Profile in the header of such a file."""
BLOCKS, EVENTS = "/palpate/samples", "/palpate/events"
BLOCK_SECONDS = 0.25
"""s of robot time between two blocks: what a process that is killed takes with it."""


class Recorded(Protocol):
    """All that has ended so far, in order, and the nominal hand."""

    hand: Hand
    gravity: float
    leaves: list[LeafRun]
    recordings: list[Recording]
    conversions: list[Conversion]


@dataclass(frozen=True, slots=True)
class Record:
    """All of a `Trace` but its samples."""

    leaves: tuple[LeafRun, ...]
    recordings: tuple[Recording, ...]
    conversions: tuple[Conversion, ...]
    hand: Hand
    gravity: float


# A faulty sensor's NaN is written as such, and read again.
Record.__pydantic_config__: ConfigDict = {"ser_json_inf_nan": "constants"}  # type: ignore[attr-defined]


class TraceStream:
    """Writes a trace block by block; `close` it in the end.

    Raises:
        OSError: the disk is full, or gone. What was written stays.
    """

    def __init__(self, path: Path, hand: Hand, gravity: float) -> None:
        from mcap.writer import Writer
        from pydantic import TypeAdapter

        self._hand, self._gravity = hand, gravity
        self._json = TypeAdapter(Record)
        self._pending: list[Samples] = []
        self._written = -np.inf
        self._recorded: Recorded | None = None
        self._seen = (0, 0, 0)
        self._file: IO[bytes] = path.open("wb")
        self._writer = Writer(self._file, use_chunking=False)
        self._writer.start(profile=PROFILE, library=f"palpate {__version__}")
        self._blocks = self._writer.register_channel(BLOCKS, "f64", 0)
        self._events = self._writer.register_channel(EVENTS, "json", 0)
        self._note(0.0, self._record((), (), ()))
        self._file.flush()

    def write(self, samples: Samples, recorded: Recorded) -> None:
        """Take over new samples, and write a block where one is due."""
        if recorded is not self._recorded:
            self._recorded, self._seen = recorded, (0, 0, 0)
        if len(samples):
            self._pending.append(samples)
        # The other way round a time that is no number would never be written.
        if self._pending and not self._pending[-1].t[-1] - self._written < BLOCK_SECONDS:
            self.flush()

    def flush(self) -> None:
        """Write what there is."""
        samples = Samples.concatenate(self._pending)
        self._pending = []
        if len(samples):
            self._written = float(samples.t[-1])
            self._message(self._blocks, self._written, _rows(samples).tobytes())
        self._write_events()
        self._file.flush()

    def close(self) -> None:
        """Write the rest, and close the file."""
        try:
            self.flush()
        finally:
            self._file.close()

    def _write_events(self) -> None:
        if self._recorded is None:
            return
        of, (a, b, c) = self._recorded, self._seen
        self._seen = (len(of.leaves), len(of.recordings), len(of.conversions))
        if self._seen != (a, b, c):
            new = self._record(of.leaves[a:], of.recordings[b:], of.conversions[c:])
            self._note(self._written, new)

    def _note(self, t: float, record: Record) -> None:
        self._message(self._events, t, redact(self._json.dump_json(record).decode()).encode())

    def _record(
        self,
        leaves: Sequence[LeafRun],
        recordings: Sequence[Recording],
        conversions: Sequence[Conversion],
    ) -> Record:
        return Record(
            tuple(leaves), tuple(recordings), tuple(conversions), self._hand, self._gravity
        )

    def _message(self, channel: int, t: float, data: bytes) -> None:
        time = max(0, round(t * 1e9)) if np.isfinite(t) else 0
        self._writer.add_message(channel, time, data, publish_time=time)


def read_stream(file: IO[bytes]) -> Trace:
    """The trace in a file that a `TraceStream` wrote, as far as it goes.

    Raises:
        ValueError: not such a file.
    """
    from mcap.records import Channel, Message
    from pydantic import TypeAdapter

    adapter = TypeAdapter(Record)
    topics: dict[int, str] = {}
    blocks: list[Samples] = []
    noted: list[Record] = []
    try:
        for record in records(file, finished=False):
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Message) and topics.get(record.channel_id) == BLOCKS:
                blocks.append(_samples(record.data))
            elif isinstance(record, Message) and topics.get(record.channel_id) == EVENTS:
                noted.append(adapter.validate_json(record.data))
    # Where the file was cut off, the reader raises anything from EndOfFile to struct.error.
    except Exception as error:
        if not noted:
            raise ValueError("it does not begin like one") from error
    if not noted:
        raise ValueError("there is nothing of palpate's in it")
    return Trace(
        Samples.concatenate(blocks),
        tuple(leaf for record in noted for leaf in record.leaves),
        tuple(recording for record in noted for recording in record.recordings),
        tuple(conversion for record in noted for conversion in record.conversions),
        noted[0].hand,
        noted[0].gravity,
    )


def _rows(samples: Samples) -> Array:
    """(n, m) all signals of each sample, in the order of `Samples`."""
    return np.column_stack([getattr(samples, signal.name) for signal in fields(samples)])


def _samples(data: bytes) -> Samples:
    """The samples in a block.

    Raises:
        ValueError: it is not made of whole rows.
    """
    widths = [len(COLUMNS.get(signal.name, "1")) for signal in fields(Samples)]
    rows = np.frombuffer(data, dtype=np.float64).reshape(-1, sum(widths))
    signals: dict[str, Array] = {}
    start = 0
    for signal, width in zip(fields(Samples), widths, strict=True):
        part = rows[:, start : start + width].copy()
        signals[signal.name] = part if signal.name in COLUMNS else part[:, 0]
        start += width
    return Samples(**signals)
