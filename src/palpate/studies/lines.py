"""Results files of studies, written line by line: a study that was killed can be continued."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar, cast

from pydantic import TypeAdapter, ValidationError

from palpate.display import json_text
from palpate.errors import InputError
from palpate.files.read import read_bytes

LARGEST = 1_000_000_000
"""Bytes of the largest results file that is read."""

Row = TypeVar("Row")


@dataclass(frozen=True, slots=True)
class Lines:
    """Growing file of JSON objects, one a line."""

    file: Path

    def read(self) -> list[dict[str, Any]]:
        """Read all complete lines; a last one without its end was cut off and is left out. Empty
        without a file.

        Raises:
            InputError: the file holds something else.
        """
        if not self.file.exists():
            return []
        content = read_bytes(self.file, LARGEST, "results of a study")
        whole = content[: content.rfind(b"\n") + 1]
        return [self._object(line) for line in whole.splitlines()]

    def read_as(self, kind: type[Row]) -> list[Row]:
        """Read all complete lines as objects of a dataclass.

        Raises:
            InputError: the file holds something else.
        """
        adapter = TypeAdapter(kind)
        try:
            return [adapter.validate_python(line) for line in self.read()]
        except ValidationError:
            raise self.other() from None

    def add(self, *rows: Mapping[str, Any]) -> None:
        """Append rows and wait until they are on the disk; without rows, just create the file.

        Raises:
            InputError: the file cannot be written.
        """
        lines = [json_text(strict_json(row)) + "\n" for row in rows]
        try:
            self.file.parent.mkdir(parents=True, exist_ok=True)
            with self.file.open("ab+") as file:
                size = file.seek(0, os.SEEK_END)
                file.seek(max(size - 1, 0))
                if size and file.read(1) != b"\n":  # a kill has left a line without its end
                    file.seek(0)
                    file.truncate(file.read().rfind(b"\n") + 1)
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


def strict_json(content: Any) -> Any:
    """Replace infinities and NaN, which JSON lacks, by words (`inf`, `nan`); pydantic reads them."""
    if isinstance(content, Mapping):
        named = cast("Mapping[str, Any]", content)
        return {name: strict_json(value) for name, value in named.items()}
    if isinstance(content, list | tuple):
        return [strict_json(value) for value in cast("Sequence[Any]", content)]
    if isinstance(content, float) and not math.isfinite(content):
        return str(content)
    return content
