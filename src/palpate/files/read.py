"""Reading of users' files: regular files only, of bounded size.

A FIFO or a terminal would block, a device may never end, and a file may grow while it is read. So the
path is examined before it is opened, it is opened without blocking, the open file is examined again,
and reading stops one byte beyond the limit.
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
    """Check a file that a library will read by its path: at most `limit` bytes; `what` names its
    purpose ("an MJCF scene").

    Raises:
        InputError: it cannot be read, is no regular file, or is larger.
    """
    try:
        _require(os.stat(path), path, limit, what)
    except (OSError, ValueError) as error:
        raise _unreadable(path, error) from None


@contextmanager
def opened(path: Path, limit: int, what: str) -> Generator[BinaryIO]:
    """Open a file of at most `limit` bytes for reading.

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
    """Read a file of at most `limit` bytes.

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
        kinds = (name for is_kind, name in _KINDS if is_kind(status.st_mode))
        kind = next(kinds, "something else")
        raise InputError(f"{path} is {kind}, not a regular file; give {what}")
    if status.st_size > limit:
        raise _too_large(path, limit, what)


def _too_large(path: Path, limit: int, what: str) -> InputError:
    size = f"{limit // MB} MB" if limit >= MB else f"{limit // 1000} kB"
    return InputError(f"{path} is larger than {size}, too large for {what}; give another")


def _unreadable(path: Path, error: OSError | ValueError) -> InputError:
    reason = getattr(error, "strerror", None) or error
    return InputError(f"cannot read {path}: {reason}")
