"""One run, one folder: everything appears at once or not at all."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any, cast

from palpate.errors import InputError
from palpate.files.read import read_text

MAX_JSON = 20_000_000
"""Largest JSON file of a run that is read."""


def default_folder(name: str) -> Path:
    """`runs/NAME-TIME` in the present folder (NAME `run` where there is none); a number is added
    where it exists."""
    stem = Path("runs") / f"{name or 'run'}-{datetime.now():%Y%m%d-%H%M%S}"
    candidates = [stem, *(stem.with_name(f"{stem.name}-{i}") for i in range(2, 100))]
    return next(c for c in candidates if not c.exists())


@contextmanager
def new_folder(path: Path) -> Generator[Path]:
    """A scratch folder beside `path` that becomes `path` when the block ends well, and is removed
    when it does not.

    Raises:
        InputError: `path` exists or cannot be made; or it came into being meanwhile, then the
            scratch folder is kept.
    """
    if path.exists():
        raise InputError(f"'{path}' exists already: choose another out=, nothing is overwritten")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    except OSError as error:
        raise InputError(f"cannot write '{path}': {error.strerror}") from error
    try:
        yield scratch
    except BaseException:
        shutil.rmtree(scratch, ignore_errors=True)
        raise
    scratch.chmod(0o755)
    try:
        scratch.rename(path)
    except OSError as error:
        raise InputError(
            f"'{path}' cannot be made any more ({error.strerror}); the run is kept in '{scratch}'"
        ) from error


def read_json(path: Path) -> dict[str, Any]:
    """The JSON object in a run folder's file.

    Raises:
        InputError: there is no such file, or no object in it.
    """
    if not path.exists():
        raise InputError(f"'{path.parent}' is not a run's folder: there is no '{path.name}' in it")
    try:
        content = json.loads(read_text(path, MAX_JSON, "a file of a run"))
    except (ValueError, RecursionError) as error:
        raise InputError(f"'{path}' is not JSON: {error}") from None
    if not isinstance(content, dict):
        raise InputError(f"'{path}' holds no JSON object")
    return cast("dict[str, Any]", content)


def write_json(path: Path, content: Any) -> None:
    """Pretty, strict JSON (no NaN)."""
    path.write_text(
        json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8"
    )
