"""Writing of new files: what is there already stays."""

from __future__ import annotations

from pathlib import Path

from palpate.errors import InputError


def write_new(path: Path, text: str) -> None:
    """Write a new text file.

    Raises:
        InputError: it exists, or cannot be written.
    """
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise InputError(f"'{path}' exists already: choose another file") from None
    except OSError as error:
        raise InputError(f"cannot write '{path}': {error.strerror}") from None
