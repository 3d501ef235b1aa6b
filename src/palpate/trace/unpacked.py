"""Records of an MCAP file, with bounded memory: neither a record nor a chunk is unpacked to more than
its bound, whatever the file claims of itself."""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import replace
from typing import IO, TYPE_CHECKING

if TYPE_CHECKING:
    from mcap.records import Chunk, McapRecord

MAX_RECORD = 64 << 20
"""Bytes of one record in the file."""
MAX_CHUNK = 8 << 20
"""Bytes of one chunk once unpacked; palpate's chunks have 1 MiB."""
MAX_RATIO = 20
"""Unpacked bytes per byte of the file, beyond one chunk; recorded signals have 4."""


def records(file: IO[bytes], finished: bool = True) -> Iterator[McapRecord]:
    """Records of the file in order, those within chunks in the place of the chunks; `finished`: check
    the sums of an ended file.

    Raises:
        ValueError: unpacked, a chunk or all of them exceed their bounds.
    """
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader, breakup_chunk

    left = MAX_CHUNK + MAX_RATIO * file.seek(0, io.SEEK_END)
    file.seek(0)
    reader = StreamReader(
        file, emit_chunks=True, validate_crcs=finished, record_size_limit=MAX_RECORD
    )
    for record in reader.records:
        if not isinstance(record, Chunk):
            yield record
            continue
        data = _unpacked(record, min(MAX_CHUNK, left))
        left -= len(data)
        yield from breakup_chunk(replace(record, compression="", data=data), validate_crc=finished)


def _unpacked(chunk: Chunk, most: int) -> bytes:
    import zstandard

    if chunk.compression == "":
        return chunk.data
    if chunk.compression != "zstd":
        raise ValueError(f"its chunks are packed with '{chunk.compression[:20]}' instead of zstd")
    unpacker = zstandard.ZstdDecompressor(max_window_size=MAX_CHUNK)
    with unpacker.stream_reader(chunk.data) as stream:
        data = stream.read(most + 1)
    if len(data) > most:
        raise ValueError("it unpacks to more than recorded signals do")
    return data
