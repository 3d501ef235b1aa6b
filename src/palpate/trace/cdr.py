"""CDR, the encoding of ROS 2 messages, for a thousand messages of one layout at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

LITTLE_ENDIAN = b"\x00\x01\x00\x00"
"""Header of every message: plain CDR, little-endian."""


class Field(NamedTuple):
    """Position of the numbers that differ from message to message: `length` of them from `offset`
    on."""

    name: str
    offset: int
    kind: str
    length: int


class Layout:
    """The bytes of a message, written from its first field to its last.

    Texts and the lengths of arrays are the same in every message; named fields are left open.
    `encode` fills them from arrays of n rows, and `decode` reads them back: a list of messages is
    one numpy array of records, the texts lie in the gaps between its fields.

    Every number stands at a multiple of its own size, counted from behind the first four bytes. A
    text is its length with the closing zero, its UTF-8 bytes and the zero; an array is its length
    and its items. A `geometry_msgs/PointStamped` is
    `Layout().time("stamp").text("world").doubles("point", 3)`:

        00 01 00 00 | sec | nanosec | 6 | w o r l d 0 | 0 0 | x | y | z
    """

    def __init__(self) -> None:
        self.constant = bytearray(LITTLE_ENDIAN)
        self.fields: list[Field] = []

    def uint8(self, value: int) -> Layout:
        """Byte that is the same in every message."""
        self.constant.append(value)
        return self

    def uint32(self, *values: int) -> Layout:
        """Four bytes each, the same in every message."""
        self._align(4)
        for value in values:
            self.constant += value.to_bytes(4, "little")
        return self

    def text(self, *values: str) -> Layout:
        """Texts, the same in every message."""
        for value in values:
            content = value.encode() + b"\0"
            self.uint32(len(content))
            self.constant += content
        return self

    def octets(self, content: bytes) -> Layout:
        """An array of bytes, the same in every message."""
        self.uint32(len(content))
        self.constant += content
        return self

    def texts(self, values: Sequence[str]) -> Layout:
        """An array of texts, the same in every message."""
        return self.uint32(len(values)).text(*values)

    def time(self, name: str) -> Layout:
        """Seconds and nanoseconds: rows of two integers."""
        return self._field(name, "<u4", 2)

    def doubles(self, name: str, count: int) -> Layout:
        """`count` numbers one after the other, such as a vector's x, y and z."""
        return self._field(name, "<f8", count)

    def array(self, name: str, count: int) -> Layout:
        """An array of `count` numbers."""
        return self.uint32(count).doubles(name, count)

    def empty_array(self) -> Layout:
        """An array without items."""
        return self.uint32(0)

    def encode(self, signals: Mapping[str, NDArray[Any]], n: int) -> list[bytes]:
        """`n` messages, from arrays (n, count) by the names of the fields; a name may stand at
        several places."""
        rows = np.frombuffer(bytearray(self.constant * n), self._dtype())
        for place, field in enumerate(self.fields):
            rows[str(place)] = signals[field.name]
        return rows.view(f"V{len(self.constant)}").tolist()

    def decode(self, messages: Sequence[bytes]) -> dict[str, NDArray[Any]]:
        """The fields of `messages` by name, (n, count) each.

        Raises:
            ValueError: a message is longer or shorter than this layout.
        """
        if any(len(message) != len(self.constant) for message in messages):
            raise ValueError(f"a message does not have {len(self.constant)} bytes")
        rows = np.frombuffer(b"".join(messages), self._dtype())
        return {field.name: rows[str(place)].copy() for place, field in enumerate(self.fields)}

    def _dtype(self) -> np.dtype[np.void]:
        """A message as a record of its open fields, named by their places; texts are gaps."""
        names: list[str] = []
        formats: list[tuple[str, tuple[int]]] = []
        offsets: list[int] = []
        for place, field in enumerate(self.fields):
            names.append(str(place))
            formats.append((field.kind, (field.length,)))
            offsets.append(field.offset)
        size = len(self.constant)
        return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": size})

    def _field(self, name: str, kind: str, length: int) -> Layout:
        size = np.dtype(kind).itemsize
        self._align(size)
        self.fields.append(Field(name, len(self.constant), kind, length))
        self.constant += bytes(size * length)
        return self

    def _align(self, size: int) -> None:
        behind_header = len(self.constant) - len(LITTLE_ENDIAN)
        self.constant += bytes(-behind_header % size)
