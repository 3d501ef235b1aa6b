"""Export and proof of a run's twin."""

from __future__ import annotations

import math
import tempfile
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from palpate.common.display import to_json
from palpate.common.errors import InputError
from palpate.common.version import __version__
from palpate.estimation.estimate import Estimate
from palpate.runs.folder import new_folder, read_json, write_json
from palpate.runs.proof import Proof, prove
from palpate.runs.result import parameter_json
from palpate.runs.run import Run
from palpate.twin.export import Export, export_twin, require_format


def export_run(run: Run, to: str, folder: Path | None = None, check: bool = False) -> Export:
    """Write the run's twin into a new folder, by default `export-FORMAT` in the run's own folder.

    With `check` it is compared by experiments in every reader that is installed.

    Raises:
        InputError: the run has no twin, there is no such format, or the folder exists or cannot be
            made.
        Unavailable: the library that writes the format is not installed, or for a check no reader.
        PalpateError: the written file differs from the twin.
    """
    # Write into a scratch folder: the export appears completely or not at all.
    chosen = require_format(to)
    if run.finished is None:
        raise InputError("this run has no twin to export: nothing was measured")
    folder = folder or (run.folder or Path()) / f"export-{chosen}"
    try:
        with new_folder(folder) as made, tempfile.TemporaryDirectory() as scratch:
            export = export_twin(run.finished, run.estimates, chosen, made, Path(scratch), check)
            export = replace(export, file=folder / export.file.relative_to(made))
            write_json(made / "export.json", export_json(run, export))
    except OSError as error:
        raise InputError(f"cannot write '{folder}': {error.strerror}") from error
    return export


def export_json(run: Run, export: Export) -> dict[str, Any]:
    """Content of `export.json`; `read_back` is true if the export contains an estimate's value."""
    return {
        "palpate": __version__,
        "format": export.format,
        "file": export.file.name,
        "simulated": run.simulated,
        "parameters": [_row_of(export, estimate) for estimate in run.estimates],
        "check": [asdict(finding) for finding in export.findings],
        "notes": list(export.notes),
    }


def _row_of(export: Export, estimate: Estimate) -> dict[str, Any]:
    """Estimate with the readers in which its value acts."""
    readers = list(export.acts_in(estimate.parameter))
    states = {"written": estimate.parameter in export.held, "read_back": bool(readers)}
    return parameter_json(estimate) | states | {"acts_in": readers}


# Proof of a run's twin, kept as `proof.json` in the run folder.

PROOF = "proof.json"  # File of a proof in a run folder


def prove_run(run: Run) -> Proof:
    """Plan tasks with the run's prior and twin, and carry them out in its truth, else in draws.
    Raises InputError: the run has no twin, its scene's file is missing, or nothing was measured."""
    if run.finished is None:
        raise InputError("this run has no twin to prove: nothing was measured")
    if not run.scene.bodies:
        raise InputError("the scene's file is gone, so that the prior is not known any more")
    return prove(run.scene, run.estimates, run.truth, run.settings.seed)


def proof_json(proof: Proof) -> dict[str, Any]:
    """Content of `proof.json`; null means an object that tips over or falls."""
    rows = [asdict(row) | {"promise95": row.promise, "depends": row.depends} for row in proof.rows]
    return to_json({"judge": proof.judge, "tasks": rows, "left_out": proof.left_out})


def read_proof(folder: Path) -> Proof | None:
    """Read the proof in a run folder, if any. Raises InputError: the file is not a proof."""
    file = folder / PROOF
    if not file.exists():
        return None
    document = read_json(file)
    try:
        # Null means an infinite error.
        for row in document["tasks"]:
            for name in ("prior", "twin", "drawn"):
                row[name] = [math.inf if error is None else error for error in row[name]]
        return TypeAdapter(Proof).validate_python(document | {"rows": document["tasks"]})
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"'{file}' is no proof: {type(error).__name__}: {error}") from None
