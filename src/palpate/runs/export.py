"""Export and proof of a run's twin."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from palpate.common.errors import InputError
from palpate.common.version import __version__
from palpate.runs.folder import new_folder, read_json, write_json
from palpate.runs.proof import Proof, Proved, prove
from palpate.runs.result import parameter_json
from palpate.runs.run import Run
from palpate.twin.export import Export, export_twin, require_format


def export_run(run: Run, to: str, folder: Path | None = None) -> Export:
    """Write the run's twin into a new folder, by default `export-FORMAT` in the run's own folder.

    Raises:
        InputError: the run has no twin, there is no such format, or the folder exists or cannot be
            made.
        Unavailable: the library that writes the format is not installed.
        PalpateError: the written file differs from the twin.
    """
    # Write into a scratch folder: the export appears completely or not at all.
    chosen = require_format(to)
    if run.finished is None:
        raise InputError("this run has no twin to export: nothing was measured")
    folder = folder or (run.folder or Path()) / f"export-{chosen}"
    try:
        with new_folder(folder) as made, tempfile.TemporaryDirectory() as scratch:
            export = export_twin(run.finished, run.estimates, chosen, made, Path(scratch))
            export = replace(export, file=folder / export.file.relative_to(made))
            write_json(made / "export.json", export_json(run, export))
    except OSError as error:
        raise InputError(f"cannot write '{folder}': {error.strerror}") from error
    return export


def export_json(run: Run, export: Export) -> dict[str, Any]:
    """Content of `export.json`."""
    return {
        "palpate": __version__,
        "format": export.format,
        "file": export.file.name,
        "simulated": run.simulated,
        "parameters": list(_rows(run, export)),
        "notes": list(export.notes),
    }


def _rows(run: Run, export: Export) -> Iterator[dict[str, Any]]:
    """List every estimate; `read_back` is true if the export contains its value."""
    for estimate in run.estimates:
        row = parameter_json(estimate)
        yield {**row, "read_back": estimate.parameter in export.held}


# Proof of a run's twin, kept as `proof.json` in the run folder.


PROOF = "proof.json"
"""File of a proof in a run folder."""


def prove_run(run: Run) -> Proof:
    """Plan tasks with the run's prior and twin, and carry them out in its truth, else in draws.

    Raises:
        InputError: the run has no twin, its scene's file is missing, or nothing was measured.
    """
    if run.finished is None:
        raise InputError("this run has no twin to prove: nothing was measured")
    if not run.scene.bodies:
        raise InputError("the scene's file is gone, so that the prior is not known any more")
    return prove(run.scene, run.estimates, run.truth, run.settings.seed)


def proof_json(proof: Proof) -> dict[str, Any]:
    """Content of `proof.json`; null means an object that tips over or falls."""
    # Infinite errors become null.
    rows: list[dict[str, Any]] = []
    for row in proof.rows:
        errors = {"prior": row.prior, "twin": row.twin, "drawn": row.drawn}
        said = {"object": row.object, "task": row.task, "says": row.says, "unit": row.unit}
        numbers = {name: _json(numbers) for name, numbers in errors.items()}
        promise = {"promise95": _json(row.promise), "depends": row.depends}
        rows.append({**said, "goal": row.goal, **numbers, **promise})
    return {"judge": proof.judge, "tasks": rows, "left_out": list(proof.left_out)}


def read_proof(folder: Path) -> Proof | None:
    """Read the proof in a run folder, if any.

    Raises:
        InputError: the file is not a proof.
    """
    file = folder / PROOF
    if not file.exists():
        return None
    document = read_json(file)
    try:
        rows = tuple(_row(row) for row in document["tasks"])
        return Proof(rows, str(document["judge"]), tuple(map(str, document["left_out"])))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"'{file}' is no proof: {type(error).__name__}: {error}") from None


def _row(row: dict[str, Any]) -> Proved:
    return Proved(
        object=str(row["object"]),
        task=str(row["task"]),
        says=str(row["says"]),
        unit=str(row["unit"]),
        goal=float(row["goal"]),
        prior=_numbers(row["prior"]),
        twin=_numbers(row["twin"]),
        drawn=_numbers(row["drawn"]),
    )


def _json(numbers: Sequence[float]) -> list[float | None]:
    return [number if math.isfinite(number) else None for number in numbers]


def _numbers(document: Sequence[float | None]) -> tuple[float, ...]:
    return tuple(math.inf if number is None else float(number) for number in document)
