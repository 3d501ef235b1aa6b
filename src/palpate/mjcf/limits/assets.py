"""Files that a scene names, looked at before MuJoCo reads them: pictures that unpack to more than
they seem, and how many bytes of meshes there are."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import BinaryIO

from palpate.errors import InputError
from palpate.files.read import opened
from palpate.mjcf.document import MAX_ASSET_BYTES

MAX_PIXELS = 64_000_000
"""Pixels of all pictures (textures and height fields) of a scene together."""

MAX_UNPACKED = 300_000_000
"""Bytes to which one picture may unpack."""

DEFLATE_RATIO = 1032
"""A byte of deflated data becomes at most so many (zlib's Technical Details)."""

PNG = b"\x89PNG\r\n\x1a\n"
_PACKED = (b"IDAT", b"zTXt", b"iTXt", b"iCCP")
"""Chunks with deflated content (PNG specification, 3rd edition, section 11)."""
_BLOCK = 1 << 16
_TEXTS = (".xml", ".mjcf", ".mjb")


def require_bounded_files(files: Iterable[Path]) -> int:
    """Check the size of pictures; return the bytes of meshes and of MuJoCo's own formats.

    Raises:
        InputError: a picture unpacks to more than is read, or all of them have too many pixels.
    """
    pixels = meshes = 0
    for path in files:
        if path.suffix.lower() in _TEXTS:
            continue
        with opened(path, MAX_ASSET_BYTES, "a file that a scene may name") as file:
            start = file.read(24)
            if start.startswith(PNG):
                pixels += _require_unpackable(path, start, file)
            else:
                meshes += path.stat().st_size
        if pixels > MAX_PIXELS:
            raise InputError(
                f"{path}: with it the scene's pictures have more than {MAX_PIXELS // 1_000_000} "
                "million pixels; use smaller ones"
            )
    return meshes


def _require_unpackable(path: Path, start: bytes, file: BinaryIO) -> int:
    """The pixels of a PNG that unpacks to what it should."""
    if len(start) < 24:
        return 0
    width, height = struct.unpack(">II", start[16:24])
    if width * height > MAX_PIXELS:
        raise InputError(
            f"{path} has {width} × {height} pixels; at most {MAX_PIXELS // 1_000_000} million are "
            "read"
        )
    # A small file cannot unpack to a large one, and need not be looked into.
    if path.stat().st_size * DEFLATE_RATIO > MAX_UNPACKED:
        _require_unpacked(path, file)
    return width * height


def _require_unpacked(path: Path, file: BinaryIO) -> None:
    unpacked = 0
    stream = zlib.decompressobj()
    for kind, content in _packed(file):
        if kind != b"IDAT":
            unpacked += len(content) * DEFLATE_RATIO
        elif not stream.eof:
            unpacked += _unpacked(stream, content)
        if unpacked > MAX_UNPACKED:
            raise InputError(
                f"{path} unpacks to more than {MAX_UNPACKED // 1_000_000} MB; use a smaller picture"
            )


def _packed(file: BinaryIO) -> Iterator[tuple[bytes, bytes]]:
    """Kind and content of the deflated chunks, in pieces."""
    file.seek(len(PNG))
    while len(head := file.read(8)) == 8:
        length, kind = struct.unpack(">I4s", head)
        if kind not in _PACKED:
            file.seek(length + 4, 1)
            continue
        while length > 0 and (content := file.read(min(length, _BLOCK))):
            length -= len(content)
            yield kind, content
        file.seek(4, 1)


def _unpacked(stream: zlib._Decompress, content: bytes) -> int:  # pyright: ignore[reportPrivateUsage]
    """Number of bytes to which the next piece unpacks."""
    try:
        return len(stream.decompress(content))
    except zlib.error:  # MuJoCo says what is wrong with it
        return 0
