"""Data of the report page, from a run."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from palpate.common.parameter import Parameter
from palpate.common.version import __version__
from palpate.estimation.estimate import Estimate
from palpate.estimation.quantities.catalogue import catalogue
from palpate.execution.stop import HeldObject
from palpate.perception.renderer import gl_available
from palpate.planning.plan import Plan
from palpate.robots.simulated.noise.models import noise_models
from palpate.runs.answer import answer
from palpate.runs.export import read_proof
from palpate.runs.held_out import HeldOut
from palpate.runs.report.sections import PoseRow, pose_rows
from palpate.runs.reproduce import reproducing, with_seen_poses
from palpate.trace.samples import Trace

if TYPE_CHECKING:
    from palpate.perception.film import Film
    from palpate.runs.proof import Proof
    from palpate.runs.run import Run
    from palpate.runs.settings import Settings
    from palpate.twin.validate import ReplayResidual, Validation


State = Literal["known", "missing", "assumed"]

LIBRARIES = ("mujoco", "mink", "py_trees", "numpy", "scipy")


@dataclass(frozen=True, slots=True)
class Pictures:
    """Pictures (PNG) and film (MP4) of a run; None for those that do not exist."""

    workspace: bytes | None = None
    before: bytes | None = None
    after: bytes | None = None
    seen: bytes | None = None
    film: Film | None = None


@dataclass(frozen=True, slots=True)
class ParameterRow:
    """Quantity of an object: its status in the scene, and whether the request names it."""

    object: str
    quantity: str
    state: State
    asked: bool
    value: tuple[float, ...] | None = None


@dataclass(frozen=True, slots=True)
class EstimateWithTruth:
    """An estimate, and the truth of a simulated world (None on a real robot)."""

    estimate: Estimate
    truth: tuple[float, ...] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ReportData:
    """Content of the page. A section without data is left out.

    Attributes:
        request: the sentence; None when only a scene was given.
        status: of the run, as in `result.json`.
        plan: with `tree` None when the request was rejected.
        world: place of the execution.
        parameters: known and missing quantities of the scene.
        poses: of objects, by sight and touch.
        measured: the estimates.
        findings: findings of the check on the plan, one line each.
        trace: None when nothing was executed.
        stopped_by: reason of an early stop.
        held: object in the fingers at the stop, and its whereabouts.
        robot_seconds: duration of the execution, robot time.
        total_seconds: wall time from the start of the command to this page.
        workspace, before, after: PNG or JPEG.
        seen: PNG of a look of a camera before the plan.
        video: MP4, played `video_speed` times faster than robot time.
        video_believed: rendered from the trace, not seen by a camera.
        twin_diff: unified diff from the user's MJCF to the twin.
        twin_checks: label to value, e.g. the residual of the replayed measurement.
        held_out: predictions of motions that were left out of the fits.
        proof: tasks planned with the twin.
        twin_notes: remarks about the twin.
        versions: name to version.
        seed, noise: of a simulated world.
        files: paths in the run folder, relative to the page.
        answer: to a request that compares.
        warnings: one line each, e.g. how to get pictures.
        simulated: no real robot moved.
        drawn: the true values were drawn from priors.
        command: reproduces the run, from the page's folder.
    """

    request: str | None
    status: Literal["running", "complete", "rejected", "aborted", "failed"]
    plan: Plan
    world: str
    parameters: tuple[ParameterRow, ...] = ()
    poses: tuple[PoseRow, ...] = ()
    measured: tuple[EstimateWithTruth, ...] = ()
    findings: tuple[str, ...] = ()
    trace: Trace | None = None
    stopped_by: str | None = None
    held: HeldObject | None = None
    robot_seconds: float | None = None
    total_seconds: float | None = None
    workspace: bytes | None = None
    before: bytes | None = None
    after: bytes | None = None
    seen: bytes | None = None
    video: bytes | None = None
    video_speed: float = 1.0
    video_believed: bool = False
    twin_diff: str = ""
    twin_checks: Mapping[str, str] = field(default_factory=dict[str, str])
    held_out: HeldOut | None = None
    proof: Proof | None = None
    twin_notes: tuple[str, ...] = ()
    versions: Mapping[str, str] = field(default_factory=dict[str, str])
    seed: int | None = None
    noise: str | None = None
    files: tuple[str, ...] = ()
    answer: str | None = None
    warnings: tuple[str, ...] = ()
    simulated: bool = False
    drawn: bool = False
    command: str = ""


def report_data(run: Run, pictures: Pictures, scratch: Path, place: Path) -> ReportData:
    """Collect the page's data; `scratch` holds the run's files, which are or will be at `place`."""
    settings, done, twin, film = run.settings, run.execution, run.finished, pictures.film
    # The page links to the files that exist already.
    files = (path for path in scratch.rglob("*") if path.is_file())
    data = ReportData(
        request=settings.request,
        status=run.status,
        plan=run.plan,
        world=run.world or "nothing was moved",
        parameters=tuple(parameter_rows(run)),
        poses=tuple(pose_rows(run.beliefs)),
        measured=tuple(EstimateWithTruth(e, run.truth.get(e.parameter)) for e in run.estimates),
        findings=tuple(f"{f.path}: {f.message}" for f in run.findings),
        trace=run.trace_if_any,
        held_out=run.held_out,
        proof=read_proof(scratch),
        workspace=pictures.workspace,
        before=pictures.before,
        after=pictures.after,
        seen=pictures.seen,
        versions={"palpate": __version__, **{name: version(name) for name in LIBRARIES}},
        seed=None if run.is_recorded else settings.seed,
        noise=None if run.is_recorded else noise_models().title(settings.noise),
        files=tuple(sorted(str(path.relative_to(scratch)) for path in files)),
        simulated=run.simulated,
        drawn=run.drawn,
        total_seconds=run.total_seconds,
        command="" if run.is_recorded else _repeating(settings, place.absolute()),
        answer=answer(run),
        warnings=tuple(run_warnings(run)),
    )
    # Add the parts that exist only after execution, twin and film.
    if done is not None:
        data = replace(
            data, stopped_by=done.stopped_by, held=done.held, robot_seconds=done.robot_seconds
        )
    if twin is not None:
        checks = twin_checks(twin.validation) if twin.validation is not None else {}
        data = replace(data, twin_diff=twin.diff, twin_notes=twin.notes, twin_checks=checks)
    if film is not None:
        data = replace(data, video=film.mp4, video_speed=film.speed, video_believed=film.believed)
    return data


def _repeating(settings: Settings, folder: Path) -> str:
    """Command that repeats the run of a folder, relative to that folder."""
    return shlex.join(reproducing(with_seen_poses(settings, folder), folder))


def stated_as(parameter: Parameter) -> Parameter:
    """The parameter under which the scene states it: a `com_3d` is a `com`."""
    quantity = catalogue().get(parameter.quantity)
    if quantity is None:
        return parameter
    return Parameter(parameter.object, quantity.known_as())


def parameter_rows(run: Run) -> Iterator[ParameterRow]:
    """Missing, known and assumed parameters of the scene, body by body."""
    # Compare requests under the names of the scene.
    asked = {stated_as(parameter) for parameter in run.plan.parameters}
    for body in run.scene.bodies.values():
        name = body.name
        for quantity in sorted(body.missing):
            yield ParameterRow(name, quantity, "missing", Parameter(name, quantity) in asked)
        for quantity, value in body.known.items():
            yield ParameterRow(name, quantity, "known", Parameter(name, quantity) in asked, value)
        for quantity in sorted(body.assumed):
            yield ParameterRow(name, quantity, "assumed", Parameter(name, quantity) in asked)


def run_warnings(run: Run) -> Iterator[str]:
    if run.drawn:
        yield (
            "Simulated, and made up: the run was given neither a robot nor a world, so the true values were "
            f"drawn from priors (seed {run.settings.seed}). No value here is one of a real thing."
        )
    available, remedy = gl_available()
    if not available:
        yield remedy


def twin_checks(validation: Validation) -> dict[str, str]:
    """Validation of the twin, as label and text."""
    rests = "yes" if validation.settled else "no"
    return {
        "Comes to rest": f"{rests}, after moving {1e3 * validation.drift:.2f} mm",
        "Plan replayed in the twin": residual_text(validation.twin),
        "Plan replayed in the scene as given": residual_text(validation.template),
    }


def residual_text(residual: ReplayResidual) -> str:
    parts: list[str] = []
    if residual.force is not None:
        parts.append(f"{residual.force:.3f} N")
    if residual.position is not None:
        parts.append(f"{1e3 * residual.position:.2f} mm")
    if not parts:
        return residual.note or "nothing to compare"
    if residual.note:
        parts.append(residual.note)
    return f"off by {', '.join(parts)}"
