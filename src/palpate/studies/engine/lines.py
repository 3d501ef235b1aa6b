"""Results of a study that are kept one by one: a study that was killed goes on where it was."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, cast

from palpate.display import json_text
from palpate.errors import InputError
from palpate.files.read import read_bytes

LARGEST = 1_000_000_000
"""Bytes of the largest results file that is read."""


@dataclass(frozen=True, slots=True)
class Lines:
    """A file of JSON objects, one a line, that grows."""

    file: Path

    def read(self) -> list[dict[str, Any]]:
        """All whole lines, none when there is no file; what a kill cut short is left out.

        Raises:
            InputError: it is another file.
        """
        if not self.file.exists():
            return []
        content = read_bytes(self.file, LARGEST, "results of a study")
        whole = content[: content.rfind(b"\n") + 1]
        return [self._object(line) for line in whole.splitlines()]

    def add(self, *rows: Mapping[str, Any]) -> None:
        """More lines, on the disk before anything else is done; without any, the file is there.

        Raises:
            InputError: the file cannot be written.
        """
        lines = [json_text(_strict(row)) + "\n" for row in rows]
        try:
            self.file.parent.mkdir(parents=True, exist_ok=True)
            with self.file.open("ab+") as file:
                _end_cleanly(file)
                file.write("".join(lines).encode())
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise InputError(f"cannot write '{self.file}': {error.strerror}") from error

    def other(self) -> InputError:
        """Error for a file whose lines belong to another study."""
        return InputError(
            f"'{self.file.name}' is not a results file of a study; choose another place with --out"
        )

    def _object(self, line: bytes) -> dict[str, Any]:
        try:
            found = json.loads(line)
        except ValueError:
            raise self.other() from None
        if not isinstance(found, dict):
            raise self.other()
        return cast("dict[str, Any]", found)


def _strict(content: Any) -> Any:
    """The same with words (`inf`, `nan`) for what JSON has no numbers for; pydantic reads them."""
    if isinstance(content, Mapping):
        named = cast("Mapping[str, Any]", content)
        return {name: _strict(value) for name, value in named.items()}
    if isinstance(content, list | tuple):
        return [_strict(value) for value in cast("Sequence[Any]", content)]
    if isinstance(content, float) and not math.isfinite(content):
        return str(content)
    return content


def _end_cleanly(file: BinaryIO) -> None:
    """Cut off a last line that a kill has left without its end."""
    size = file.seek(0, os.SEEK_END)
    if size == 0:
        return
    file.seek(size - 1)
    if file.read(1) == b"\n":
        return
    file.seek(0)
    file.truncate(file.read().rfind(b"\n") + 1)
