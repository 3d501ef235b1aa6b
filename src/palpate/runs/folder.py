"""Run folder: it appears atomically, and grows stage by stage."""

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

import numpy as np

from palpate.common.display import json_text
from palpate.common.errors import InputError
from palpate.common.files import read_text, writing, yaml_text
from palpate.common.redaction import redact, redact_document
from palpate.primitives.registry import vocabulary
from palpate.runs.reproduce import POSES
from palpate.runs.result import CYCLES, has_own_scene, plan_text, result_json
from palpate.runs.run import TRACE, Run
from palpate.runs.shown import trace_messages
from palpate.trace.mcap import write_mcap

OTHER_FOLDER = "; choose another out="  # Remedy for a folder that cannot be written
MAX_JSON = 20_000_000  # Maximum size of a JSON file of a run, bytes

_HOST = f"{zlib.crc32(platform.node().encode()):08x}"
# Name of a scratch folder, with the machine and the process that made it.
_SCRATCH = re.compile(r"\..+\.palpate-([0-9a-f]{8})-([0-9]+)-\w+")


def default_folder(name: str) -> Path:
    """Return `runs/NAME-TIME` in the working directory, with a number added if it exists."""
    stem = Path("runs") / f"{name or 'run'}-{datetime.now():%Y%m%d-%H%M%S}"
    candidates = [stem, *(stem.with_name(f"{stem.name}-{i}") for i in range(2, 100))]
    return next(c for c in candidates if not c.exists())


def check_writable(path: Path) -> None:
    """Test by a trial that a folder can be made at `path`; the trial is removed. Raises InputError:
    it exists or cannot be made."""
    _check_free(path)
    # Write a file into the nearest existing parent.
    folder = next(parent for parent in path.absolute().parents if parent.exists())
    with writing(path, OTHER_FOLDER):
        trial = _scratch(folder, path.name)
        try:
            (trial / "trial").write_bytes(b"trial")
        finally:
            shutil.rmtree(trial, ignore_errors=True)


def growing_folder(path: Path) -> None:
    """Make the folder of a run that begins. Raises InputError: it exists or cannot be made."""
    _check_free(path)
    with writing(path, OTHER_FOLDER):
        path.parent.mkdir(parents=True, exist_ok=True)
        sweep(path.parent)
        path.mkdir()


@contextmanager
def new_folder(path: Path) -> Generator[Path]:
    """Yield a scratch folder next to `path`.

    After the block it is renamed to `path`. If the block raises, it is removed.
    Raises InputError: `path` exists or cannot be made. If it was created meanwhile, the run is kept next to it.
    """
    _check_free(path)
    # Make the scratch folder in the same parent, so that the rename is atomic.
    with writing(path, OTHER_FOLDER):
        path.parent.mkdir(parents=True, exist_ok=True)
        sweep(path.parent)
        scratch = _scratch(path.parent, path.name)
    try:
        yield scratch
    except BaseException:
        shutil.rmtree(scratch, ignore_errors=True)
        raise
    # mkdtemp makes private folders: restore the usual permissions.
    scratch.chmod(0o755)
    try:
        scratch.rename(path)
    except OSError as error:
        kept = _keep_scratch(scratch, path)
        raise InputError(
            f"'{path}' cannot be made any more ({error.strerror}); the run is kept in '{kept}'"
        ) from error


def sweep(folder: Path) -> None:
    """Remove scratch folders of killed processes of this machine."""
    for entry in folder.iterdir():
        match = _SCRATCH.fullmatch(entry.name)
        # Remove folders whose process has ended; other machines may share the disk.
        if match and match[1] == _HOST and not _alive(int(match[2])):
            shutil.rmtree(entry, ignore_errors=True)


@contextmanager
def replacing(path: Path) -> Generator[Path]:
    """Yield a temporary file next to `path`.

    After the block it replaces `path` atomically. If the block raises, it is removed.
    """
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


def _scratch(parent: Path, name: str) -> Path:
    prefix = f".{name}.palpate-{_HOST}-{os.getpid()}-"
    return Path(tempfile.mkdtemp(prefix=prefix, dir=parent))


def _keep_scratch(scratch: Path, path: Path) -> Path:
    """Rename a scratch folder whose target was taken, so that `sweep` does not remove it."""
    # Find a free name with a number.
    for i in range(2, 100):
        renamed = path.with_name(f"{path.name}-{i}")
        try:
            return scratch.rename(renamed)
        except OSError:
            continue
    return scratch


def _alive(process: int) -> bool:
    """Test that a process of this machine still runs."""
    try:
        # Signal 0 tests for the process without affecting it.
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


def read_json(path: Path) -> dict[str, Any]:
    """Read the JSON object in a file of a run folder. Raises InputError: there is no such file, or
    no object in it."""
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
    write_text(path, json_text(redact_document(content), indent=2) + "\n")


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically, keys of the environment redacted."""
    with replacing(path) as part:
        part.write_text(redact(text), encoding="utf-8", newline="")


# Files of a run in its folder, without request, pictures and page.


def write_files(run: Run, scratch: Path, folder: Path) -> None:
    """Write plan, conversation, scene, tree, trace, twin and result into `scratch`, which will become `folder`."""
    write_plan(run, scratch)
    write_trace(run, scratch)
    write_twin(run, scratch)
    write_json(scratch / "result.json", result_json(run, folder))


def write_plan(run: Run, folder: Path) -> None:
    """Write the files that exist before the execution: plan, conversation, tree, rehearsal, scene,
    poses that a camera saw."""
    write_text(folder / "plan.json", plan_text(run))
    if run.conversation is not None:
        write_text(folder / "conversation.json", run.conversation.dump())
    if run.ready and run.plan.tree is not None:
        from palpate.planning.btcpp import tree_xml

        write_text(folder / "tree.xml", tree_xml(run.plan, vocabulary()))
    if run.rehearsal is not None:
        from palpate.execution.rehearsal import keep_rehearsal

        keep_rehearsal(folder, run.plan, run.scene, run.rehearsal)
    _write_scene(run, folder)


def write_trace(run: Run, folder: Path) -> None:
    """Write the finished trace over the growing one, and the log of cycles before a stop."""
    if run.trace_if_any is not None:
        with replacing(folder / TRACE) as part:
            write_mcap(part, run.trace_if_any, trace_messages(run))
    if run.black_box is not None:
        with replacing(folder / CYCLES) as part, part.open("wb") as file:
            np.savez(file, **dict[str, Any](run.black_box))


def write_twin(run: Run, folder: Path) -> None:
    """Write the twin with the files that it needs, and the scene as completed by contact."""
    if run.finished is not None:
        for name, text in run.finished.packed(folder).items():
            write_text(folder / name, text)
    _write_scene(run, folder)


def _write_scene(run: Run, folder: Path) -> None:
    # A run with a camera keeps the poses that the camera saw.
    if run.settings.camera is not None:
        kept = run.scene.resolved.poses.model_dump(mode="json", exclude_defaults=True)
        write_text(folder / POSES, yaml_text(kept))
    if has_own_scene(run):
        write_text(folder / "scene.xml", run.scene.text)
