"""Contents of a run's page: pictures and rows."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from palpate import __version__
from palpate.parameter import Parameter
from palpate.pictures.dress import looks_in
from palpate.pictures.film import Film, Filming, film_speed, frames_of
from palpate.pictures.moments import render_before_after, render_moment, render_scene
from palpate.pictures.renderer import gl_available, png
from palpate.report.data import Measured, ParameterRow, ReportData
from palpate.report.tables import stated_as
from palpate.robots.simulated.noise.models import noise_models
from palpate.runs.answer import answer
from palpate.runs.folder import replacing
from palpate.runs.reproduce import reproducing
from palpate.scene.camera import load_image

if TYPE_CHECKING:
    from palpate.runs.run import Ending, Run
    from palpate.twin.twin import Twin
    from palpate.twin.validate import Residual, Validation

IMAGES, STILLS = "images", ("workspace.png", "before.png", "after.png")
"""A run's pictures: their folder, and their names in it."""
FILMS = {False: "execution.mp4", True: "played-again.mp4"}
"""The names of films: seen by a camera, or believed."""
LIBRARIES = ("mujoco", "mink", "py_trees", "numpy", "scipy")


@dataclass(frozen=True, slots=True)
class Pictures:
    """PNG and MP4 of a run; None where there is nothing to show or no OpenGL to show it with."""

    workspace: bytes | None = None
    before: bytes | None = None
    after: bytes | None = None
    film: Film | None = None


def pictures_in(folder: Path, run: Run) -> Pictures:
    """The pictures of a run that its folder holds already."""

    def content(name: str) -> bytes | None:
        file = folder / IMAGES / name
        return file.read_bytes() if file.exists() else None

    workspace, before, after = (content(name) for name in STILLS)
    for believed, name in FILMS.items():
        video = content(name)
        if video is not None and run.execution is not None:
            moving = Film(video, film_speed(run.execution.robot_seconds), believed)
            return Pictures(workspace, before, after, moving)
    return Pictures(workspace, before, after)


def take_stills(run: Run, taken: Pictures) -> Pictures:
    """`taken` with workspace, before and after, as far as there is something to see and a way to
    see it."""
    workspace = run.picture or taken.workspace
    if run.settings.images:
        workspace = png(load_image(run.settings.images[0]))
    taken = replace(taken, workspace=workspace)
    if not gl_available()[0]:
        return taken
    names = tuple(run.scene.bodies)
    before = run.scene.spec()
    if run.finished is None or run.finished.scene is None:
        return replace(taken, workspace=workspace or render_scene(before, names))
    seen, looks = run.footage, None
    if seen is not None and seen.spec is not None:
        looks = looks_in(seen.spec)
    pair = render_before_after(before, run.finished.scene.spec(), names, looks=looks)
    if workspace is None and seen is not None:
        _, qpos = frames_of(seen.frames)
        workspace = render_moment(seen.model, qpos[0], seen.drawn())
    return Pictures(workspace, *pair, taken.film)


def take_film(run: Run, taken: Pictures, filming: Filming | None = None) -> Pictures:
    """`taken` with the film, where the cell's camera saw something: with that which is in the making,
    else with one that is made now."""
    if run.footage is None or run.settings.fast:
        return taken
    with filming or Filming(run.footage, run.trace_if_any) as made:
        return replace(taken, film=made.film())


def write_images(pictures: Pictures, folder: Path) -> None:
    """The pictures as files of their own, in the run's folder."""
    folder = folder / IMAGES
    folder.mkdir(exist_ok=True)
    stills = (pictures.workspace, pictures.before, pictures.after)
    contents = dict(zip(STILLS, stills, strict=True))
    if pictures.film is not None:
        contents[FILMS[pictures.film.believed]] = pictures.film.mp4
    for name, content in contents.items():
        if content is not None:
            with replacing(folder / name) as part:
                part.write_bytes(content)


def report_data(run: Run, pictures: Pictures, scratch: Path, place: Path) -> ReportData:
    """Data of the page, with the files in `scratch`, which is or will be at `place`."""
    settings = run.settings
    data = ReportData(
        request=settings.request,
        status=run.status,
        plan=run.plan,
        world=run.world or "nothing was moved",
        parameters=tuple(_parameter_rows(run)),
        measured=tuple(_measured(run)),
        findings=tuple(f"{f.path}: {f.message}" for f in run.findings),
        trace=run.trace_if_any,
        held_out=run.held_out,
        workspace=pictures.workspace,
        before=pictures.before,
        after=pictures.after,
        versions={"palpate": __version__, **{name: version(name) for name in LIBRARIES}},
        seed=settings.seed,
        noise=noise_models().title(settings.noise),
        files=tuple(_files(scratch)),
        simulated=run.simulated,
        drawn=run.drawn,
        total_seconds=run.total_seconds,
        command=shlex.join(reproducing(settings, place.absolute())),
    )
    if run.execution is not None:
        data = _with_execution(data, run.execution)
    if run.finished is not None:
        data = _with_twin(data, run.finished)
    if pictures.film is not None:
        film = pictures.film
        data = replace(data, video=film.mp4, video_speed=film.speed, video_believed=film.believed)
    return replace(data, answer=answer(run), warnings=tuple(_warnings(run)))


def _warnings(run: Run) -> Iterator[str]:
    if run.drawn:
        yield (
            "Simulated, and made up: the run was given neither a robot nor a world, so the true values were "
            f"drawn from priors (seed {run.settings.seed}). No value here is one of a real thing."
        )
    available, remedy = gl_available()
    if not available:
        yield remedy


def _with_execution(data: ReportData, done: Ending) -> ReportData:
    return replace(
        data,
        stopped_by=done.stopped_by,
        held=done.held,
        robot_seconds=done.robot_seconds,
    )


def _with_twin(data: ReportData, twin: Twin) -> ReportData:
    if twin.validation is not None:
        data = replace(data, twin_checks=twin_checks(twin.validation))
    return replace(data, twin_diff=twin.diff, twin_notes=twin.notes)


def _files(scratch: Path) -> list[str]:
    """Every file that is there already, relative to the run folder."""
    files = (path for path in scratch.rglob("*") if path.is_file())
    return sorted(str(path.relative_to(scratch)) for path in files)


def _parameter_rows(run: Run) -> Iterator[ParameterRow]:
    """Missing, known and assumed parameters of the scene, body by body."""
    asked = {stated_as(parameter) for parameter in run.plan.parameters}
    for body in run.scene.bodies.values():
        name = body.name
        for quantity in sorted(body.missing):
            yield ParameterRow(name, quantity, "missing", Parameter(name, quantity) in asked)
        for quantity, value in body.known.items():
            yield ParameterRow(name, quantity, "known", Parameter(name, quantity) in asked, value)
        for quantity in sorted(body.assumed):
            yield ParameterRow(name, quantity, "assumed", Parameter(name, quantity) in asked)


def _measured(run: Run) -> list[Measured]:
    return [Measured(e, run.truth.get(e.parameter)) for e in run.estimates]


def twin_checks(marks: Validation) -> dict[str, str]:
    """The twin's marks in words and figures."""
    rests = "yes" if marks.settled else "no"
    return {
        "Comes to rest": f"{rests}, after moving {1e3 * marks.drift:.2f} mm",
        "Plan replayed in the twin": _shown(marks.twin),
        "Plan replayed in the scene as given": _shown(marks.template),
    }


def _shown(residual: Residual) -> str:
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
