"""Comparison of the estimates of several runs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from palpate.common.display import table, text_table, to_json
from palpate.common.errors import InputError
from palpate.common.parameter import ByParameter, Parameter
from palpate.common.pose import Array
from palpate.common.version import __version__
from palpate.estimation.estimate import Estimate, Shared
from palpate.estimation.fusion import Source, difference
from palpate.runs.fuse import arm_of, differences, names_of, parameters_of, shared_recordings
from palpate.runs.result import shape_value
from palpate.runs.run import Run

COLUMNS = ("parameter", "run", "value ± std", "difference in stds", "verdict")


@dataclass(frozen=True, slots=True, eq=False)
class ComparedEstimate:
    """Estimate of one run in a comparison."""

    run: str  # name of the run
    estimate: Estimate | None  # None if the run did not measure the parameter
    # (n,) from the first run with a value; None for that run, and without a value.
    difference: Array | None = None
    std: Array | None = None  # (n,) of the difference, without errors that both runs share

    @property
    def z(self) -> Array | None:
        """Difference in units of its standard deviation, (n,)."""
        if self.difference is None or self.std is None:
            return None
        return self.difference / self.std


@dataclass(frozen=True, slots=True, eq=False)
class Comparison(ByParameter[tuple[ComparedEstimate, ...]]):
    """Comparison of several runs: `comparison["mug.mass"]` has a row of each run.

    Attributes:
        names: folders of the runs.
        rows: rows by parameter, in the order of the runs.
        remarks: differences of their scenes and worlds.
    """

    runs: tuple[Run, ...]
    names: tuple[str, ...]
    rows: dict[Parameter, tuple[ComparedEstimate, ...]]
    remarks: tuple[str, ...]

    def _entries(self) -> dict[Parameter, tuple[ComparedEstimate, ...]]:
        return self.rows

    def __repr__(self) -> str:
        return f"<Comparison of {len(self.runs)} runs: {self._list_parameters()}>"

    def __str__(self) -> str:
        """Table with a row for each parameter and run."""
        return text_table(COLUMNS, self._cells())

    def _repr_html_(self) -> str:
        return table(repr(self), COLUMNS, self._cells())

    def _cells(self) -> list[tuple[str, ...]]:
        cells: list[tuple[str, ...]] = []
        for row in (row for rows in self.rows.values() for row in rows):
            if row.estimate is not None:
                # Row of the table; the first run of a parameter has no difference.
                name, value, _, verdict = row.estimate.cells()
                deviations = "" if row.z is None else ", ".join(f"{z:+.1f}" for z in row.z.tolist())
                cells.append((name, row.run, value, deviations, verdict))
        return cells

    def _list_parameters(self) -> str:
        """List the parameters with their largest difference from the first run."""
        items: list[str] = []
        for parameter, rows in self.rows.items():
            # Largest difference over all runs and components.
            deviations = [float(np.abs(row.z).max()) for row in rows if row.z is not None]
            far = f" {max(deviations):.1f} std apart" if deviations else ""
            items.append(f"{parameter}{far}")
        return ", ".join(items) or "nothing"


def compare_runs(runs: Sequence[Run]) -> Comparison:
    """Compare all parameters of two or more runs, each run with the first that has a value.

    Raises InputError: fewer than two runs.
    """
    if len(runs) < 2:
        raise InputError("give two runs or more to compare")
    names = names_of(runs)
    # Collect the differences of the scenes; a different scene changes which errors are shared.
    remarks = [f"{same}: they cannot differ" for same in shared_recordings(runs, names)]
    one_scene = True
    for name, run in zip(names[1:], runs[1:], strict=True):
        differing = list(differences(runs[0], run))
        if differing:
            remarks.append(f"{names[0]} and {name} are not of one scene: {'; '.join(differing)}")
            one_scene = False
    # Compare the runs parameter by parameter.
    rows: dict[Parameter, tuple[ComparedEstimate, ...]] = {}
    for parameter in parameters_of(runs):
        rows[parameter] = tuple(_rows(parameter, runs, names, one_scene))
    return Comparison(tuple(runs), names, rows, tuple(remarks))


def _rows(
    parameter: Parameter, runs: Sequence[Run], names: Sequence[str], one_scene: bool
) -> Iterator[ComparedEstimate]:
    first: Source | None = None
    for name, run in zip(names, runs, strict=True):
        estimate = {e.parameter: e for e in run.estimates}.get(parameter)
        if estimate is None or not estimate.has_value:
            yield ComparedEstimate(name, estimate)
            continue
        source = Source(name, arm_of(run), estimate)
        # Only runs of one scene share the errors of the scene.
        if not one_scene:
            source = _rename_scene_causes(source)
        # The first run with a value is the reference of all later ones.
        if first is None or len(first.estimate.values) != len(estimate.values):
            first = first or source
            yield ComparedEstimate(name, estimate)
        else:
            yield ComparedEstimate(name, estimate, *difference(first, source))


def _rename_scene_causes(source: Source) -> Source:
    """Rename the shared causes of a run of another scene: only those of the arm are common."""
    # Causes of the scene get the name of the run, so that they do not cancel.
    shared: list[Shared] = []
    for error in source.estimate.shared:
        cause = error.cause if error.of == "arm" else f"{error.cause} of {source.run}"
        shared.append(replace(error, cause=cause))
    return replace(source, estimate=replace(source.estimate, shared=tuple(shared)))


def comparison_json(comparison: Comparison) -> dict[str, Any]:
    """Comparison as JSON: scalars for quantities of one component, lists for the others."""
    # The runs, then their estimates parameter by parameter.
    runs: list[dict[str, Any]] = []
    for name, run in zip(comparison.names, comparison.runs, strict=True):
        where = None if run.folder is None else run.folder.absolute()
        of = {"simulated": run.simulated, "arm": arm_of(run), "world": run.world}
        runs.append({"name": name, "folder": where, "status": run.status} | of)
    parameters: list[dict[str, Any]] = []
    for parameter, rows in comparison.rows.items():
        unit = next(row.estimate.unit for row in rows if row.estimate is not None)
        row = asdict(parameter) | {"unit": unit, "runs": [_row_json(row) for row in rows]}
        parameters.append(row)
    return to_json(
        {
            "runs": runs,
            "parameters": parameters,
            "remarks": comparison.remarks,
            "provenance": {"palpate": __version__},
        }
    )


def _row_json(row: ComparedEstimate) -> dict[str, Any]:
    estimate = row.estimate
    return {
        "run": row.run,
        "value": shape_value(None if estimate is None else estimate.values),
        "std": shape_value(None if estimate is None else estimate.stds),
        "verdict": None if estimate is None else estimate.verdict,
        "difference": shape_value(row.difference),
        "difference_std": shape_value(row.std),
        "z": shape_value(row.z),
    }
