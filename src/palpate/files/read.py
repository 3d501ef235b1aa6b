"""The one way in which palpate opens a file that somebody hands it: regular files only, and never
more of them than their kind may have.

A FIFO or a terminal would wait for ever, a device may never end, and a file may grow while it is
read. So the path is looked at before it is opened, the opening does not wait, what was opened is
looked at again, and one byte more than the limit is enough to refuse it.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from palpate.errors import InputError

MB = 1_000_000

_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a FIFO"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)

_FLAGS = sum({getattr(os, name, 0) for name in ("O_NONBLOCK", "O_NOCTTY", "O_CLOEXEC", "O_BINARY")})
"""Flags beside O_RDONLY; not every system has all of them."""


def require_regular(path: Path, limit: int, what: str) -> None:
    """A file that a library will read by its path; `what` it is for ("an MJCF scene"), and how many
    bytes it may have.

    Raises:
        InputError: it cannot be read, is no regular file, or is larger.
    """
    try:
        _require(os.stat(path), path, limit, what)
    except (OSError, ValueError) as error:
        raise _unreadable(path, error) from None


@contextmanager
def opened(path: Path, limit: int, what: str) -> Generator[BinaryIO]:
    """The file, open for reading; a size beyond `limit` bytes is refused before the first is read.

    Raises:
        InputError: as `require_regular`.
    """
    require_regular(path, limit, what)
    try:
        descriptor = os.open(path, os.O_RDONLY | _FLAGS)
    except OSError as error:
        raise _unreadable(path, error) from None
    with os.fdopen(descriptor, "rb") as file:
        _require(os.fstat(descriptor), path, limit, what)
        yield file


def read_bytes(path: Path, limit: int, what: str) -> bytes:
    """All of a file of at most `limit` bytes.

    Raises:
        InputError: as `require_regular`; also when it grows beyond the limit while it is read.
    """
    with opened(path, limit, what) as file:
        try:
            content = file.read(limit + 1)
        except OSError as error:
            raise _unreadable(path, error) from None
    if len(content) > limit:
        raise _too_large(path, limit, what)
    return content


def read_text(path: Path, limit: int, what: str) -> str:
    """Read and decode a file, as `read_bytes`.

    Raises:
        InputError: as `read_bytes`; also when it is not UTF-8.
    """
    try:
        return read_bytes(path, limit, what).decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not utf-8 text (byte {error.start})") from None


def _require(status: os.stat_result, path: Path, limit: int, what: str) -> None:
    if not stat.S_ISREG(status.st_mode):
        raise InputError(f"{path} is {_kind(status.st_mode)}, not a regular file; give {what}")
    if status.st_size > limit:
        raise _too_large(path, limit, what)


def _kind(mode: int) -> str:
    for is_kind, name in _KINDS:
        if is_kind(mode):
            return name
    return "something else"


def _too_large(path: Path, limit: int, what: str) -> InputError:
    return InputError(f"{path} is larger than {_size(limit)}, too large for {what}; give another")


def _size(limit: int) -> str:
    if limit >= MB:
        return f"{limit // MB} MB"
    return f"{limit // 1000} kB"


def _unreadable(path: Path, error: OSError | ValueError) -> InputError:
    reason = getattr(error, "strerror", None) or error
    return InputError(f"cannot read {path}: {reason}")
