"""Fusion of several runs of one scene into one estimate per parameter."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from palpate.common.display import table, text_table, to_json
from palpate.common.errors import InputError
from palpate.common.files import writing
from palpate.common.parameter import Parameter
from palpate.common.version import __version__
from palpate.estimation.estimate import COLUMNS, Estimate, Estimates, not_identified
from palpate.estimation.fusion import Source, fuse
from palpate.runs.building import estimates_to_write
from palpate.runs.folder import new_folder, write_json, write_text
from palpate.runs.result import parameter_json, twin_json
from palpate.runs.run import Run
from palpate.runs.settings import Settings
from palpate.twin.twin import Twin, build_twin


@dataclass(frozen=True, eq=False, repr=False)
class Fusion(Estimates):
    """Fusion of several runs.

    Attributes:
        names: folders of the runs.
        estimates: one per parameter of any run.
        left_out: excluded estimates with the reason, a line each.
        twin: the scene with the fused values.
        folder: folder that it was written to, if any.
    """

    runs: tuple[Run, ...]
    names: tuple[str, ...]
    estimates: tuple[Estimate, ...]
    left_out: tuple[str, ...]
    twin: Twin
    folder: Path | None = None

    @property
    def identified(self) -> bool:
        """True if every parameter is identified."""
        return all(estimate.identified for estimate in self.estimates)

    def save(self, folder: str | Path) -> Fusion:
        """Write result and twin into a new folder. Raises InputError: the folder exists or cannot be made."""
        folder = Path(folder)
        with writing(folder), new_folder(folder) as scratch:
            for name, text in self.twin.packed(scratch).items():
                write_text(scratch / name, text)
            write_json(scratch / "result.json", fusion_json(self, folder))
        return replace(self, folder=folder)

    def __str__(self) -> str:
        """The estimates as a table of text."""
        return text_table(COLUMNS, [estimate.cells() for estimate in self.estimates])

    def _repr_html_(self) -> str:
        rows = [estimate.cells() for estimate in self.estimates]
        return table(f"<Fusion of {len(self.runs)} runs>", COLUMNS, rows)

    def __repr__(self) -> str:
        estimates = ", ".join(repr(estimate).strip("<>") for estimate in self.estimates)
        return f"<Fusion of {len(self.runs)} runs: {estimates}>"


def fuse_runs(runs: Sequence[Run]) -> Fusion:
    """Fuse the estimates of each parameter and build the twin.

    Raises InputError: fewer than two runs, runs that are not of one scene, or the same recordings twice.
    """
    if len(runs) < 2:
        raise InputError("give two runs or more to fuse")
    # Require runs of one scene with different recordings.
    names = names_of(runs)
    for name, run in zip(names[1:], runs[1:], strict=True):
        differing = list(differences(runs[0], run))
        if differing:
            raise InputError(f"{names[0]} and {name} are not of one scene: {'; '.join(differing)}")
    if same := next(shared_recordings(runs, names), ""):
        raise InputError(f"{same}: a measurement is not counted twice")
    # Fuse each parameter over the runs that give evidence for it; list the other estimates.
    estimates: list[Estimate] = []
    left_out: list[str] = []
    for parameter in parameters_of(runs):
        candidates = [
            Source(name, arm_of(run), run[parameter])
            for name, run in zip(names, runs, strict=True)
            if parameter in run
        ]
        sources = [source for source in candidates if source.estimate.is_evidence]
        left_out += [
            _explain_omission(source) for source in candidates if not source.estimate.is_evidence
        ]
        # A prior is no evidence: without an identified estimate there is no fused value.
        unknown = not_identified(parameter, candidates[0].estimate.unit, "No run identified it.")
        fused = fuse(sources) if sources else unknown
        estimates.append(replace(fused, simulated=runs[0].simulated))
    twin = build_twin(runs[0].scene, estimates_to_write(runs[0], estimates))
    return Fusion(tuple(runs), names, tuple(estimates), tuple(left_out), twin)


def _explain_omission(source: Source) -> str:
    """Describe an estimate that is left out, with the reason."""
    estimate = source.estimate
    reason = estimate.contradiction or estimate.doubt or estimate.method
    return f"{estimate.parameter} of {source.run} is {estimate.verdict}: {reason}"


def arm_of(run: Run) -> str:
    """Identity of a run's arm: noise model and seed of a simulated one, address of a real one."""
    asked: Settings = run.settings
    if asked.robot is not None:
        return asked.robot
    if not run.simulated:
        return "an arm that is not known"
    return f"the simulated {asked.arm} of {asked.noise}, seed {asked.seed}"


def fusion_json(fusion: Fusion, folder: Path | None) -> dict[str, Any]:
    """Content of the fusion's `result.json`."""
    # Paths exist only for a saved fusion.
    files: dict[str, Path] = {}
    if folder is not None:
        files = {"result": folder / "result.json", "twin": folder / "twin.xml"}
    runs: list[dict[str, Any]] = []
    for name, run in zip(fusion.names, fusion.runs, strict=True):
        where = None if run.folder is None else run.folder.absolute()
        runs.append({"name": name, "folder": where, "status": run.status, "arm": arm_of(run)})
    content = {
        "status": "complete" if fusion.identified else "failed",
        "simulated": fusion.runs[0].simulated,
        "runs": runs,
        "parameters": [parameter_json(estimate) for estimate in fusion.estimates],
        "left_out": fusion.left_out,
        "twin": twin_json(fusion.twin),
        "files": {kind: file.absolute() for kind, file in files.items()},
        "provenance": {"palpate": __version__},
    }
    return to_json(content)


def names_of(runs: Sequence[Run]) -> tuple[str, ...]:
    """Names of the runs' folders: their last parts if those differ, else whole paths."""
    # Prefer short names, as long as they differ.
    short: list[str] = []
    long: list[str] = []
    for i, run in enumerate(runs):
        unsaved = f"run {i + 1}"
        short.append(unsaved if run.folder is None else run.folder.name)
        long.append(unsaved if run.folder is None else str(run.folder))
    return tuple(short if len(set(short)) == len(short) else long)


def parameters_of(runs: Sequence[Run]) -> list[Parameter]:
    """Parameters of all runs, each once, in order."""
    promised = [estimate.parameter for run in runs for estimate in run.estimates]
    return list(dict.fromkeys(promised))


def differences(first: Run, other: Run) -> Iterator[str]:
    """Describe the differences of the scenes and worlds of two runs."""
    # Same text and same poses mean the same scene.
    if not first.scene.bodies or not other.scene.bodies:
        yield "the scene's file is gone"
        return
    if first.scene.text != other.scene.text:
        yield f"their MJCF differ ({_first_difference(first.scene.text, other.scene.text)})"
    elif _places(first) != _places(other):
        yield "their poses differ"
    if first.settings.arm != other.settings.arm:
        yield f"their arms differ ({first.settings.arm}, {other.settings.arm})"
    if first.simulated != other.simulated:
        yield "one is simulated, one is not"
    elif first.simulated:
        yield from _other_world(first, other)


def _other_world(first: Run, other: Run) -> Iterator[str]:
    """Describe the difference of two simulated worlds: another file, or another draw from the priors."""
    worlds = [run.settings.world and run.settings.world.absolute() for run in (first, other)]
    # Drawn worlds are equal only for equal seeds.
    drawn = [run.world is not None and "drawn from priors" in run.world for run in (first, other)]
    if worlds[0] != worlds[1] or drawn[0] != drawn[1]:
        yield f"their worlds differ ({first.world}, {other.world})"
    elif all(drawn) and first.settings.seed != other.settings.seed:
        seeds = f"{first.settings.seed} and {other.settings.seed}"
        yield f"their worlds were drawn from priors with seeds {seeds}: they are two worlds"


def _places(run: Run) -> list[tuple[str, tuple[float, ...]]]:
    places: list[tuple[str, tuple[float, ...]]] = []
    for body in run.scene.bodies.values():
        pose = body.pose_world
        numbers = np.round([*pose.position, *pose.quaternion], 9).tolist()
        places.append((body.name, tuple(numbers)))
    return places


def _first_difference(text: str, other: str) -> str:
    """Find the first line in which two texts differ."""
    for line in difflib.ndiff(text.splitlines(), other.splitlines()):
        if line[:2] in ("- ", "+ "):
            return line[2:].strip()
    return "in their white space"


def shared_recordings(runs: Sequence[Run], names: Sequence[str]) -> Iterator[str]:
    """Yield a sentence for each run that holds the recordings of an earlier one.

    Values and deviations identify a recording: independent measurements never agree in every bit.
    """
    seen: dict[tuple[Any, ...], str] = {}
    for name, run in zip(names, runs, strict=True):
        every = [
            (estimate.parameter, *estimate.values.tolist(), *estimate.stds.tolist())
            for estimate in run.estimates
            if estimate.has_value
        ]
        if twin := next((seen[numbers] for numbers in every if numbers in seen), ""):
            yield f"{twin} and {name} hold the same recordings"
        seen |= dict.fromkeys(every, name)
