"""Write report and run folder, and read a run from its folder."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.common.files import writing
from palpate.common.processes import Fork
from palpate.execution.cell import Cell
from palpate.runs.building import TemplateRun
from palpate.runs.estimating import add_views
from palpate.runs.executing import end_execution
from palpate.runs.folder import default_folder, new_folder, read_json, write_files, write_json
from palpate.runs.run import Run
from palpate.runs.settings import Settings, request_json, settings_from
from palpate.runs.workplace import footage_of

if TYPE_CHECKING:
    from palpate.perception.film import Reel, Shot
    from palpate.runs.report.writing import Darkroom


def folder_for(settings: Settings) -> Path:
    """Return the folder that the settings name, else a new one under `runs`."""
    if settings.out is not None:
        return settings.out
    title, scene = "", settings.scene
    if scene is not None:
        # Name a file called `scene.xml` by its folder.
        title = scene.resolve().parent.name if scene.stem == "scene" else scene.stem
    return default_folder(title)


def film_while_moving(
    run: Run, cell: Cell, given: Fork[TemplateRun] | None
) -> AbstractContextManager[Reel | None]:
    """Render the film of the execution while the arm moves; None if there is no film.

    The availability of OpenGL is tested meanwhile. Rendering begins when the execution in the scene
    as `given` has determined the view.
    """
    if run.folder is None or not run.simulated or run.settings.fast:
        return nullcontext()
    from palpate.perception.film import Reel
    from palpate.perception.renderer import look_ahead

    # A run without pictures is complete as well.
    with suppress(OSError):
        look_ahead()
    if given is None:
        return nullcontext()

    def plan_shot() -> Shot | None:
        touched = given.sent()
        return None if touched is None else touched.shot

    return Reel(partial(footage_of, cell), plan_shot)


def render_in_background(
    run: Run, reel: Reel | None = None
) -> AbstractContextManager[Darkroom | None]:
    """Render the film of the execution, and later the pictures, in separate processes.

    None for a run that is not saved, was not filmed, or is `fast`. `reel` has rendered a part of
    the film.
    """
    if run.folder is None or run.footage is None or run.settings.fast:
        return nullcontext()
    from palpate.runs.report.writing import Darkroom

    return Darkroom(run, reel)


def write_report(run: Run, folder: Path, darkroom: Darkroom | None = None) -> Run:
    """Write pictures and page of an otherwise finished run; failures are added to its shortfalls."""
    from palpate.runs.report.writing import write_all

    # The charts need the data of the fits, which the folder lacks.
    shown = add_views(replace(run, stage=None))
    shortfalls = write_all(shown, folder, darkroom)
    return replace(run, shortfalls=(*run.shortfalls, *shortfalls))


def save(run: Run, folder: Path | None = None) -> Run:
    """Save a run that is in memory into a folder: request, plan, tree, trace, result, twin, report and images.

    `folder` must not exist; by default it is the settings' `out`, else a new one under `runs`.
    Raises InputError: the folder exists or cannot be made.
    """
    from palpate.runs.report.writing import write_all

    folder = folder or folder_for(run.settings)
    with writing(folder), new_folder(folder) as scratch:
        write_json(scratch / "request.json", request_json(run.settings))
        write_files(run, scratch, folder)
        shortfalls = write_all(add_views(run), scratch, place=folder)
    return replace(run, folder=folder, shortfalls=(*run.shortfalls, *shortfalls))


def reopen(folder: Path, made_again: bool = False) -> Run:
    """Read the run that `save` wrote into `folder`. Its trace is read on first access.

    With `made_again`, a damaged `result.json` counts as that of a run that ended while executing."""
    from palpate.runs.read import read_run

    settings = settings_from(read_json(folder / "request.json"))
    return read_run(folder, settings, made_again)


def add_footage(run: Run) -> Run:
    """Render footage for a film from the trace of the run."""
    from palpate.perception.posed import played_again

    trace = run.trace_if_any
    if trace is None or not len(trace.t):
        return run
    return replace(run, footage=played_again(run.scene, trace))


def resume_run(folder: Path) -> Run:
    """Read an unfinished run from `folder`, ready for its remaining stages.

    The result is not `fast`, and has no interruption and no shortfalls.
    """
    run = reopen(folder, made_again=True)
    hurried, unhurried = run.settings.fast, replace(run.settings, fast=False)
    run = replace(run, settings=unhurried, interrupted=None, shortfalls=())
    # A `fast` run has skipped the validation of its twin, the pictures and the film.
    if hurried and run.stage is None and run.finished is not None:
        return replace(run, stage="building the twin")
    if run.stage == "executing" and run.execution is None:
        return end_execution(run)
    return run
