"""Finished runs: save, estimate again, export, prove, fuse, compare."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import wraps
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from palpate.common.display import table
from palpate.common.errors import InputError, perhaps
from palpate.common.files import writing
from palpate.common.processes import single_threaded_blas
from palpate.estimation.estimate import COLUMNS
from palpate.planning.planner import Planner
from palpate.runs import pipeline
from palpate.runs.answer import answer
from palpate.runs.callbacks import Progress, RunCallbacks, ignore
from palpate.runs.compare import Comparison, compare_runs
from palpate.runs.estimating import reestimate
from palpate.runs.folder import write_json
from palpate.runs.fuse import Fusion, fuse_runs
from palpate.runs.run import Run as InnerRun
from palpate.runs.saving import reopen, save, write_report

if TYPE_CHECKING:
    from palpate.runs.proof import Proof
    from palpate.twin.export import Export


P = ParamSpec("P")
R = TypeVar("R")
# Half widths of intervals, by quantity or by parameter: `{"mass": "1g"}`, SI numbers, or `"mass=1g,
# com=2mm"`.
Widths = Mapping[str, str | float] | str | Sequence[str]


def known_keywords(verb: Callable[P, R], more: Iterable[str] = ()) -> Callable[P, R]:
    """Decorate a function: an unknown keyword raises a TypeError that names the nearest known one.

    `more` are keywords that it takes as `**options`.
    """
    known = [name for name in signature(verb).parameters if name not in ("self", "options")]
    known += more

    @wraps(verb)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        # Suggest the nearest known name.
        for name in kwargs:
            if name not in known:
                guess = perhaps(name, known) or f" it takes {', '.join(known)}"
                raise TypeError(f"{verb.__name__}() has no argument '{name}';{guess}")
        return verb(*args, **kwargs)

    return checked


def is_text(source: object) -> bool:
    """True for MJCF text, in contrast to a file name."""
    return isinstance(source, str) and source.lstrip().startswith("<")


def is_file(source: object) -> bool:
    """True for the name of a file."""
    return isinstance(source, str | Path) and not is_text(source)


def planner_name(planner: str | Planner) -> str:
    """Name of a planner, for the settings."""
    named: Any = planner  # the settings refuse other types
    return getattr(named, "name", named)


def contents_of(source: Any, kind: type) -> dict[str, Any]:
    """Values of the fields of the dataclass `kind` in an instance of it, to construct a subclass."""
    return {part.name: getattr(source, part.name) for part in fields(kind) if part.init}


# Public class of runs, and functions over several runs.


@dataclass(frozen=True, eq=False, repr=False)
class Run(InnerRun):
    """Result of a run: `run["mug.mass"]`, `run.trace`, `run.twin`. See `palpate.runs.run.Run`."""

    @known_keywords
    def save(self, folder: str | Path) -> Run:
        """Write the run folder: request, plan, tree, trace, result, twin, report and images.

        Returns:
            This run with its folder.

        Raises:
            InputError: the folder exists or cannot be made.
        """
        return run_of(save(self, Path(folder)))

    @known_keywords
    def estimate(self, estimators: Mapping[str, str] | None = None) -> Run:
        """Estimate again from the trace.

        Nothing moves, and the folder is not changed.

        Args:
            estimators: names by quantity, `{"mass": "single-shot"}`; else the defaults.

        Returns:
            The run with the new estimates, without a twin.

        Raises:
            InputError: it has no trace, another version recorded it, or there is no such estimator.
        """
        with single_threaded_blas():
            return run_of(reestimate(self, estimators))

    @known_keywords
    def export(self, to: str, folder: str | Path | None = None, check: bool = False) -> Export:
        """Write the twin for another simulator into a new folder, and read it back.

        Args:
            to: `mjcf` (with every file that it needs), `urdf`, `usd`, or `randomisation` (ranges
                for training).
            folder: by default `export-FORMAT` in the run's own.
            check: compare it by experiments in every simulator that is installed and reads it.

        Raises:
            InputError: it has no twin, there is no such format, or the folder exists or cannot be
                made.
            Unavailable: the library that writes the format is not installed, or for a check no
                simulator that reads it.
            PalpateError: the written file differs from the twin.
        """
        from palpate.runs.export import export_run

        return export_run(self, to, None if folder is None else Path(folder), check)

    @known_keywords
    def load_data(self, to: str, object: str | None = None) -> str:
        """Write a measured load as data for a robot's controller.

        Args:
            to: `franka-desk`, `franka`, `ur`, `kuka` or `ros`.
            object: the load, if several were measured.

        Returns:
            Text with units, frame and standard deviations.

        Raises:
            InputError: there is no such format or load, or its mass or centre of mass is not
                identified.
        """
        from palpate.runs.export import write_load_data

        return write_load_data(self, to, object)

    def prove(self) -> Proof:
        """Prove the twin by tasks: a push, a topple and a throw of each measured object, an opening
        of each drawer or door.

        Each task is planned with the prior and with the twin. The result is its distance from the
        goal with the true values, or else with values drawn from the twin's intervals. A saved run
        keeps the proof in `proof.json` and shows it in its report.
        Raises InputError: it has no twin, or no object was measured.
        """
        from palpate.runs.export import PROOF, proof_json
        from palpate.runs.proof import prove

        if self.finished is None:
            raise InputError("this run has no twin to prove: nothing was measured")
        if not self.scene.bodies:
            raise InputError("the scene's file is gone, so that the prior is not known any more")
        proof = prove(self.scene, self.estimates, self.truth, self.settings.seed)
        # A saved run keeps its proof and shows it in the report.
        if self.folder is not None:
            with writing(self.folder / PROOF):
                write_json(self.folder / PROOF, proof_json(proof))
            write_report(self, self.folder)
        return proof

    @property
    def answer(self) -> str | None:
        """Answer to a request that compares or adds up; None for other requests."""
        return answer(self)

    def _repr_html_(self) -> str:
        return table(repr(self), COLUMNS, [estimate.cells() for estimate in self.estimates])


@known_keywords
def open(folder: str | Path) -> Run:
    """Read the run in a folder that `Run.save` or the command line wrote.

    The trace is read at first use. A folder does not keep the camera's footage. If the scene's file
    was removed, the scene is empty. Raises InputError: there is no such folder, or it is not a run's.
    """
    return run_of(reopen(Path(folder)))


@known_keywords
def fuse(runs: Sequence[str | Path | InnerRun]) -> Fusion:
    """Fuse the estimates of several runs of one scene.

    Each parameter gets the minimum-variance mean of its identified estimates. Errors that runs of
    one arm, or of one scene, share (gains, fingertips, poses) are not averaged away. Runs that
    disagree make the parameter *contradicted*.

    Args:
        runs: folders or `Run` objects.

    Raises:
        InputError: fewer than two runs, runs that are not of one scene, or the same recordings
            twice.
    """
    opened = [run if isinstance(run, InnerRun) else open(run) for run in runs]
    with single_threaded_blas():
        return fuse_runs(opened)


@known_keywords
def compare(runs: Sequence[str | Path | InnerRun]) -> Comparison:
    """Compare the estimates of several runs, each with the first run that has a value.

    Args:
        runs: folders or `Run` objects. Runs of another scene get a remark.

    Raises:
        InputError: fewer than two runs, or a folder that is not a run's.
    """
    return compare_runs([run if isinstance(run, InnerRun) else open(run) for run in runs])


def finish(folder: str | Path, progress: Progress = ignore, film: bool = False) -> Run:
    """Finish an interrupted run from its folder and write its report again.

    With `film`, a film of its trace is rendered as well.
    Raises InputError: there is no such folder, or it is not a run's.
    """
    return run_of(pipeline.finish(Path(folder), RunCallbacks(progress=progress), film))


def run_of(run: InnerRun) -> Run:
    """Make the public object of a run."""
    return Run(**contents_of(run, InnerRun))
