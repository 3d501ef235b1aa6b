"""Proof of a run's twin: made, and kept as `proof.json` in the run folder."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from palpate.errors import InputError
from palpate.runs.folder import read_json
from palpate.runs.run import Run
from palpate.twin.tasks.proof import Proof, Proved, prove

PROOF = "proof.json"
"""File of a proof in a run folder."""


def prove_run(run: Run) -> Proof:
    """Plan tasks with the run's prior and twin, and carry them out in its truth, else in draws.

    Raises:
        InputError: the run has no twin, its scene's file is gone, or nothing was measured.
    """
    if run.finished is None:
        raise InputError("this run has no twin to prove: nothing was measured")
    if not run.scene.bodies:
        raise InputError("the scene's file is gone, so that the prior is not known any more")
    return prove(run.scene, run.estimates, run.truth, run.settings.seed)


def proof_json(proof: Proof) -> dict[str, Any]:
    """Content of `proof.json`; null stands for an object that tips over or falls."""
    rows: list[dict[str, Any]] = []
    for row in proof.rows:
        errors = {"prior": row.prior, "twin": row.twin, "drawn": row.drawn}
        said = {"object": row.object, "task": row.task, "says": row.says, "unit": row.unit}
        numbers = {name: _json(numbers) for name, numbers in errors.items()}
        promise = {"promise95": _json(row.promise), "depends": row.depends}
        rows.append({**said, "goal": row.goal, **numbers, **promise})
    return {"judge": proof.judge, "tasks": rows, "left_out": list(proof.left_out)}


def read_proof(folder: Path) -> Proof | None:
    """The proof that a run folder holds, if any.

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
