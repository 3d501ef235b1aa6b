"""Run folder. A finished one appears atomically; a growing one has its stage in result.json, and each of
its files is complete at any time."""

from __future__ import annotations

import json
import os
import platform
import re
import shutil
import tempfile
import zlib
from collections.abc import Generator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any, cast

from palpate.display import json_text
from palpate.errors import InputError
from palpate.files.read import read_text
from palpate.redaction import redact, redacted

MAX_JSON = 20_000_000
"""Maximum size of a JSON file of a run, bytes."""

_HOST = f"{zlib.crc32(platform.node().encode()):08x}"
_SCRATCH = re.compile(r"\..+\.palpate-([0-9a-f]{8})-([0-9]+)-\w+")
"""Name of a scratch folder, with the machine and the process that made it."""


def default_folder(name: str) -> Path:
    """Return `runs/NAME-TIME` in the working directory, with a number added if it exists."""
    stem = Path("runs") / f"{name or 'run'}-{datetime.now():%Y%m%d-%H%M%S}"
    candidates = [stem, *(stem.with_name(f"{stem.name}-{i}") for i in range(2, 100))]
    return next(c for c in candidates if not c.exists())


def check_writable(path: Path) -> None:
    """Test by a trial that a folder can be made at `path`; the trial is removed.

    Raises:
        InputError: it exists or cannot be made.
    """
    _check_free(path)
    there = next(parent for parent in path.absolute().parents if parent.exists())
    try:
        trial = _scratch(there, path.name)
        try:
            (trial / "trial").write_bytes(b"trial")
        finally:
            shutil.rmtree(trial, ignore_errors=True)
    except OSError as error:
        raise _unwritable(path, error) from error


def growing_folder(path: Path) -> None:
    """Make the folder of a run that begins.

    Raises:
        InputError: it exists or cannot be made.
    """
    _check_free(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        sweep(path.parent)
        path.mkdir()
    except OSError as error:
        raise _unwritable(path, error) from error


@contextmanager
def new_folder(path: Path) -> Generator[Path]:
    """Yield a scratch folder beside `path` that is renamed to `path` after the block, or removed if
    the block raises.

    Raises:
        InputError: `path` exists or cannot be made; if it was created meanwhile, the run is kept
            beside it.
    """
    _check_free(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        sweep(path.parent)
        scratch = _scratch(path.parent, path.name)
    except OSError as error:
        raise _unwritable(path, error) from error
    try:
        yield scratch
    except BaseException:
        shutil.rmtree(scratch, ignore_errors=True)
        raise
    scratch.chmod(0o755)
    try:
        scratch.rename(path)
    except OSError as error:
        kept = _kept(scratch, path)
        raise InputError(
            f"'{path}' cannot be made any more ({error.strerror}); the run is kept in '{kept}'"
        ) from error


def sweep(folder: Path) -> None:
    """Remove scratch folders of killed processes of this machine."""
    for entry in folder.iterdir():
        found = _SCRATCH.fullmatch(entry.name)
        if found and found[1] == _HOST and not _alive(int(found[2])):
            shutil.rmtree(entry, ignore_errors=True)


@contextmanager
def replacing(path: Path) -> Generator[Path]:
    """Yield a file beside `path` that replaces it atomically after the block, or is removed if the
    block raises."""
    part = path.with_name(f"{path.name}.part")
    try:
        yield part
        part.replace(path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def _check_free(path: Path) -> None:
    if path.exists():
        raise InputError(f"'{path}' exists already: choose another out=, nothing is overwritten")


def _unwritable(path: Path, error: OSError) -> InputError:
    return InputError(f"cannot write '{path}': {error.strerror}; choose another out=")


def _scratch(parent: Path, name: str) -> Path:
    prefix = f".{name}.palpate-{_HOST}-{os.getpid()}-"
    return Path(tempfile.mkdtemp(prefix=prefix, dir=parent))


def _kept(scratch: Path, path: Path) -> Path:
    """Rename a scratch folder whose target was taken, so that `sweep` does not remove it."""
    for i in range(2, 100):
        beside = path.with_name(f"{path.name}-{i}")
        try:
            return scratch.rename(beside)
        except OSError:
            continue
    return scratch


def _alive(process: int) -> bool:
    """Test that a process of this machine still runs."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


def read_json(path: Path) -> dict[str, Any]:
    """Read the JSON object in a file of a run folder.

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
    """Write indented, strict JSON (no NaN) atomically, keys of the environment redacted."""
    write_text(path, json_text(redacted(content), indent=2) + "\n")


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically, keys of the environment redacted."""
    with replacing(path) as part:
        part.write_text(redact(text), encoding="utf-8", newline="")
