"""The whole story on one page: a sentence, or an incomplete scene, becomes a digital twin.

request + scene + pictures ─► parameters ─► plan ─► (check) ─► tree ─ticks─► trace ─► estimates
─► twin + report
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from palpate import stages
from palpate.cells.cell import Cell
from palpate.errors import ExecutionAborted
from palpate.planning.check.check import Finding
from palpate.planning.planner import Planner
from palpate.quantities.estimators import estimate_all
from palpate.robots.registry import load_description
from palpate.runs.folder import default_folder, new_folder, read_json, write_json
from palpate.runs.run import Ending, Run
from palpate.scene.camera import load_image
from palpate.scene.load import load_scene
from palpate.scene.scene import Scene
from palpate.settings import Settings, request_json, settings_from
from palpate.twin.twin import build_twin as build

if TYPE_CHECKING:
    from palpate.execution.runner import Observer

Progress = Callable[[str], None]
"""Told which stage begins."""
Confirm = Callable[[Run], bool]
"""Shown a plan before a real robot moves; whether it may."""


def quiet(_: str) -> None:
    """Tell nobody which stage begins."""


def unasked(_: Run) -> bool:
    """Let the robot move without asking anybody."""
    return True


def run(
    settings: Settings,
    observer: Observer | None = None,
    progress: Progress = quiet,
    may_move: Confirm = unasked,
) -> Run:
    """From settings to a finished run folder.

    Raises:
        InputError: bad input. Unavailable: planner or robot out of reach. ExecutionAborted: not
            confirmed.
    """
    settings = settings.checked()
    scene = load(settings)
    progress("planning")
    made = rehearse(plan(settings, scene), progress)
    confirm(made, may_move)
    made = build_twin(measure(made, observer, progress), progress)
    progress("writing the report")
    return save(made)


def load(settings: Settings) -> Scene | None:
    """D and the poses that came with it, or None without D; the pictures are checked on the way."""
    for image in settings.images:
        load_image(image)
    if settings.scene is None:
        return None
    return load_scene(settings.scene, settings.poses, load_description(settings.arm))


def plan(settings: Settings, scene: Scene | None, planner: Planner | None = None) -> Run:
    """A plan and what the check finds wrong with it; a plan without a tree is an honest rejection.

    `planner` is asked, else the one that the settings name. Without D the scene is made of what a
    model saw in the picture.

    Raises:
        InputError: bad input. Unavailable: the provider.
    """
    return stages.ask_planner(settings, scene, planner)


def rehearse(made: Run, progress: Progress = quiet) -> Run:
    """A rehearsal where the settings want one; a failure in it is a finding, and a plan with
    findings is not executed."""
    wanted = made.settings.rehearse
    if wanted is None:
        wanted = made.settings.robot is not None
    if not wanted or not made.ready:
        return made
    from palpate.execution.rehearsal import rehearse as rehearse_plan

    progress("rehearsing in simulation")
    rehearsal = rehearse_plan(made.plan, made.scene)
    progress(f"rehearsal: {rehearsal}")
    if rehearsal.failure is None:
        return replace(made, rehearsal=rehearsal)
    failed = Finding.of("tree", "rehearsal", f"in simulation the plan fails: {rehearsal.failure}")
    return replace(made, rehearsal=rehearsal, findings=(failed,))


def confirm(made: Run, may_move: Confirm, cell: Cell | None = None) -> None:
    """Ask before a real robot moves, that of `cell` or of the settings; a simulation needs no
    confirmation.

    Raises:
        ExecutionAborted: the plan was not confirmed.
    """
    real = made.settings.robot is not None or (cell is not None and not cell.simulated)
    if real and made.ready and not may_move(made):
        raise ExecutionAborted("the plan was not confirmed; nothing has moved")


def measure(
    made: Run,
    observer: Observer | None = None,
    progress: Progress = quiet,
    cell: Cell | None = None,
) -> Run:
    """From a checked plan to estimates, in `cell`, else in the one that the settings name. A plan
    with findings, or without a tree, is rejected: nothing moves."""
    if not made.ready:
        return made
    cell = cell or stages.cell_for(made.settings, made.scene, seen=made.seen is not None)
    return estimate(execute(made, cell, observer, progress), cell, progress)


def execute(
    made: Run, cell: Cell, observer: Observer | None = None, progress: Progress = quiet
) -> Run:
    """From a plan to a trace."""
    robot = cell.robot()
    progress(f"executing on the {'simulated' if cell.simulated else 'real'} robot")
    done = stages.perform(made.plan, made.scene, robot, observer, made.settings.on_failure)
    return replace(
        made,
        world=cell.description,
        simulated=cell.simulated,
        execution=Ending.of(done),
        final_state=done.final_state,
        recorded=done.trace,
        footage=cell.footage(),
    )


def estimate(made: Run, cell: Cell, progress: Progress = quiet) -> Run:
    """From a trace to estimates; what is true is asked when they are made, never before."""
    assert made.trace is not None
    progress("estimating")
    estimates = estimate_all(made.plan.parameters, made.trace, made.scene.bodies)
    known = {e.parameter: cell.truth(e.parameter) for e in estimates}
    truth = {parameter: values for parameter, values in known.items() if values is not None}
    return replace(made, estimates=estimates, truth=truth)


def build_twin(made: Run, progress: Progress = quiet) -> Run:
    """From estimates to a twin of the scene as it was believed in the end."""
    if made.final_state is None or made.trace is None:
        return made
    progress("building the twin, and touching it in simulation")
    replay = partial(stages.replay, made.scene, made.plan)
    scene = made.final_state.scene if made.seen else made.scene
    twin = build(scene, made.estimates, made.trace, replay)
    return replace(made, scene=scene, twin=twin)


def save(made: Run, folder: Path | None = None) -> Run:
    """The run folder: request, plan, tree, trace, result, twin, report and images.

    `folder` must not exist; without one it is the settings' own, else a new one under `runs`.

    Raises:
        InputError: the folder exists or cannot be made.
    """
    from palpate.report.contents import report_data, take_pictures, write_images
    from palpate.report.page import write_report
    from palpate.runs.files import write_files

    folder = folder or made.settings.out or default_folder(_name(made.settings))
    with new_folder(folder) as scratch:
        write_json(scratch / "request.json", request_json(made.settings))
        write_files(made, scratch, folder)
        pictures = take_pictures(made)
        write_images(pictures, scratch / "images")
        write_report(scratch / "report.html", report_data(made, pictures, scratch))
    return replace(made, folder=folder)


def reopen(folder: Path) -> Run:
    """The run that `save` wrote into `folder`; its trace is read when first asked for.

    Raises:
        InputError: there is no such folder, or it is not a run's.
    """
    from palpate.runs.read import read_run

    settings = settings_from(read_json(folder / "request.json"))
    return read_run(folder, settings)


def _name(settings: Settings) -> str:
    """What a run folder is named after."""
    return settings.scene.resolve().parent.name if settings.scene else ""
