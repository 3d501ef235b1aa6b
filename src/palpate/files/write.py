"""Writing of new files: what is there already stays."""

from __future__ import annotations

from pathlib import Path

from palpate.errors import InputError


def write_new(path: Path, content: str | bytes) -> None:
    """Write a new file; text as UTF-8.

    Raises:
        InputError: it exists, or cannot be written.
    """
    try:
        with path.open("xb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
    except FileExistsError:
        raise InputError(f"'{path}' exists already: choose another file") from None
    except OSError as error:
        raise InputError(f"cannot write '{path}': {error.strerror}") from None
