"""Export of a run's twin: a new folder with its files and `export.json`."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from palpate import __version__
from palpate.errors import InputError
from palpate.runs.folder import new_folder, write_json
from palpate.runs.result import parameter_json
from palpate.runs.run import Run
from palpate.twin.export.export import Export, export_twin, require_format


def export_run(run: Run, to: str, folder: Path | None = None) -> Export:
    """Write the run's twin into a new folder, by default `export-FORMAT` in the run's own.

    Raises:
        InputError: the run has no twin, there is no such format, or the folder exists or cannot be
            made.
        Unavailable: what writes the format is not installed.
        PalpateError: what was written does not say what the twin says.
    """
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
    """Every estimate, and whether it was read back from the export."""
    for estimate in run.estimates:
        row = parameter_json(estimate)
        yield {**row, "read_back": estimate.parameter in export.held}
