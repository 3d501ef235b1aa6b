"""The whole story on one page: a sentence, or an incomplete scene, becomes a digital twin.

request + scene + pictures ─► parameters ─► plan ─► (check) ─► tree ─ticks─► trace ─► estimates
─► twin + report
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from palpate import stages
from palpate.cells.cell import Cell
from palpate.errors import ExecutionAborted, InputError
from palpate.execution.recovery import Resume, nobody
from palpate.interrupt import interrupts
from palpate.planning.check.check import Finding
from palpate.planning.planner import Planner
from palpate.robots.robot import Remembering
from palpate.runs.folder import (
    check_writable,
    default_folder,
    new_folder,
    read_json,
    write_json,
)
from palpate.runs.keeper import Keeper, Step
from palpate.runs.run import Ending, Run, Stage
from palpate.scene.camera import load_image
from palpate.scene.load import load_scene
from palpate.scene.scene import Scene
from palpate.settings import Settings, request_json, settings_from
from palpate.twin.twin import build_twin as build

if TYPE_CHECKING:
    from palpate.execution.runner import Keep, Observer
    from palpate.report.writing import Darkroom
    from palpate.runs.fuse import Fusion
    from palpate.twin.export.export import Export

T = TypeVar("T")
Progress = Callable[[str], None]
"""Told which stage begins."""
Confirm = Callable[[Run], bool]
"""Shown a plan before a real robot moves; whether it may."""
Measured = Callable[[Run], None]
"""Shown the run as soon as its values are final, before twin, film and report."""


def quiet(_: str) -> None:
    """Tell nobody which stage begins."""


def unasked(_: Run) -> bool:
    """Let the robot move without asking anybody."""
    return True


def unheard(_: Run) -> None:
    """Show the values to nobody before all is done."""


def run(
    settings: Settings,
    observer: Observer | None = None,
    progress: Progress = quiet,
    may_move: Confirm = unasked,
    measured: Measured = unheard,
    may_resume: Resume = nobody,
) -> Run:
    """From settings to a finished run folder.

    Raises:
        InputError: bad input. Unavailable: planner or robot out of reach. ExecutionAborted: not
            confirmed, or interrupted before anything moved.
    """
    settings = settings.checked()
    folder = settings.out or default_folder(_name(settings))
    check_writable(folder)
    with _before_anything_moves("planning"):
        preflight(settings)
        scene = load(settings)
        progress("planning")
        made = plan(settings, scene)
    return carry_out(
        made,
        observer,
        progress,
        may_move,
        folder=folder,
        measured=measured,
        may_resume=may_resume,
    )


def carry_out(
    made: Run,
    observer: Observer | None = None,
    progress: Progress = quiet,
    may_move: Confirm = unasked,
    cell: Cell | None = None,
    folder: Path | None = None,
    measured: Measured = unheard,
    may_resume: Resume = nobody,
) -> Run:
    """From a plan to a finished run, kept in `folder` while it grows, or in memory alone. `may_resume` is
    asked where a real robot was stopped.

    A signal ends it: while executing in a controlled stop, after which what was measured is still
    made something of; else where it stands. What fails once something has moved is one of the run's
    `shortfalls`.

    Raises:
        InputError: bad input, or a folder that cannot be written. Unavailable: the robot is out of
            reach. ExecutionAborted: not confirmed, or interrupted before anything moved.
    """
    progress = _unfailing(progress)
    with interrupts() as signals:
        with _before_anything_moves("rehearsing"):
            made = rehearse(made, progress)
            confirm(made, may_move, cell)
            if not made.ready:
                return made if folder is None else save(made, folder)
            seen = made.seen is not None
            cell = cell or stages.cell_for(made.settings, made.scene, seen=seen)
        made = replace(made, world=cell.description, simulated=cell.simulated)
        keeper = Keeper(folder, signals)
        made = keeper.begin(made, request_json(made.settings))
        made = keeper.executed(
            partial(_executed, cell, observer, progress, keeper, may_resume), made
        )
        with _pictures_of(made) as darkroom:
            return _finished(made, keeper, progress, cell, darkroom, _unfailing(measured))


def finish(folder: Path, progress: Progress = quiet) -> Run:
    """Do what a run that was cut off, or was in a hurry, has left to do, with what its folder holds,
    and write its report anew. A film is not made later: what the camera saw is kept nowhere.

    Raises:
        InputError: there is no such folder, or it is not a run's.
    """
    made = reopen(folder)
    hurried, unhurried = made.settings.fast, replace(made.settings, fast=False)
    with interrupts() as signals:
        keeper = Keeper(folder, signals)
        made = replace(made, settings=unhurried, interrupted=None, shortfalls=())
        if hurried and made.stage is None and made.twin is not None:
            made = replace(made, stage="building the twin")
        if made.stage == "executing":
            if made.execution is None:
                made = stages.cut_off(made)
            keeper.trace(made)
            made = replace(made, stage="estimating")
        return _finished(made, keeper, _unfailing(progress))


def _finished(
    made: Run,
    keeper: Keeper,
    progress: Progress,
    cell: Cell | None = None,
    darkroom: Darkroom | None = None,
    measured: Measured = unheard,
) -> Run:
    """All stages after the execution, from the one that is due; a signal ends them."""
    steps: dict[Stage, Step] = {
        "estimating": partial(_measured, cell, progress, measured),
        "building the twin": partial(_twinned, keeper, progress, darkroom),
        "writing the report": partial(_reported, keeper, progress, darkroom),
    }
    if made.interrupted is not None:
        return made
    due = list(steps)
    if made.stage in due:
        due = due[due.index(made.stage) :]
    elif made.stage is None:
        due = due[-1:]
    for stage in due:
        made = keeper.through(stage, steps[stage], made)
        if made.interrupted is not None:
            return made
    return keeper.finished(made)


def preflight(settings: Settings) -> None:
    """That the robot which the settings name answers, before anybody thinks about a plan for it.

    Raises:
        InputError: no such URL. Unavailable: it does not answer.
    """
    if settings.robot is not None:
        stages.connected(settings, None)


def load(settings: Settings) -> Scene | None:
    """D and the poses that came with it, or None without D; the pictures are checked on the way."""
    for image in settings.images:
        load_image(image)
    if settings.scene is None:
        return None
    arm = settings.described_arm()
    return load_scene(
        settings.scene,
        settings.poses,
        arm,
        root=settings.root,
        robot_body=settings.robot_body,
    )


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
    """From a checked plan to estimates in memory, in `cell`, else in the one that the settings name.
    A plan with findings, or without a tree, is rejected: nothing moves.

    Raises:
        Interrupted: a signal came; the arm has stopped.
    """
    if not made.ready:
        return made
    with interrupts() as signals, signals.raised():
        cell = cell or stages.cell_for(made.settings, made.scene, seen=made.seen is not None)
        return estimate(execute(made, cell, observer, progress), cell, progress)


def execute(
    made: Run,
    cell: Cell,
    observer: Observer | None = None,
    progress: Progress = quiet,
    keep: Keep | None = None,
    may_resume: Resume = nobody,
) -> Run:
    """From a plan to a trace; `keep` writes it down meanwhile. `may_resume` is asked where a real robot
    was stopped."""
    robot, before = stages.robot_of(cell, may_resume)
    progress(f"executing on the {'simulated' if cell.simulated else 'real'} robot")
    policy, within = made.settings.on_failure, made.settings.within
    plan, scene, real = made.plan, made.scene, not cell.simulated
    done = stages.perform(
        plan, scene, robot, observer, policy, keep, within, progress, real, may_resume
    )
    ending = Ending.of(done)
    return replace(
        made,
        world=cell.description,
        simulated=cell.simulated,
        execution=replace(ending, setbacks=(*before, *ending.setbacks)),
        final_state=done.final_state,
        recorded=done.trace,
        black_box=robot.black_box() if isinstance(robot, Remembering) else None,
        footage=stages.footage_of(cell),
    )


def estimate(made: Run, cell: Cell | None, progress: Progress = quiet) -> Run:
    """From a trace to estimates; what is true is asked when they are made, never before."""
    for grown in _estimated(cell, progress, made):
        made = grown
    return made


def reestimate(made: Run, choice: Mapping[str, str] | None = None) -> Run:
    """The run with its estimates made anew from its trace, in memory and without a twin: nothing
    moves, and its folder stays as it is. `choice` names estimators by quantity.

    Raises:
        InputError: it has no trace, another version recorded it, or there is no such estimator.
    """
    return stages.estimates_anew(made, choice or {})


def build_twin(made: Run, progress: Progress = quiet) -> Run:
    """From estimates to a twin of the scene as it was believed in the end."""
    if made.trace is None:
        return made
    progress("building the twin")
    scene = made.scene
    if made.seen and made.final_state is not None:
        scene = made.final_state.scene
    twin = build(scene, made.estimates)
    return replace(made, scene=scene, twin=twin)


def touch_twin(made: Run, planned_in: Scene, progress: Progress = quiet) -> Run:
    """The run with its twin touched in simulation as the real things were, by the plan that was made
    for `planned_in`."""
    if made.twin is None:
        return made
    progress("touching the twin in simulation")
    return stages.touched(made, planned_in)


def fuse(runs: Sequence[Run]) -> Fusion:
    """What several runs of one scene say together: one estimate a parameter, and the twin of them.

    Raises:
        InputError: fewer than two runs, runs that are not of one scene, or the same recordings twice.
    """
    from palpate.runs.fuse import fuse_runs

    return fuse_runs(runs)


def export(made: Run, to: str, folder: Path | None = None) -> Export:
    """The twin of a run for other simulators, in a new folder.

    Raises:
        InputError: no twin, no such format, a folder that exists. Unavailable: what writes the
            format. PalpateError: what was written does not say what the twin says.
    """
    from palpate.runs.export import export_run

    return export_run(made, to, folder)


def save(made: Run, folder: Path | None = None) -> Run:
    """The folder of a run that is in memory: request, plan, tree, trace, result, twin, report and
    images, all at once.

    `folder` must not exist; without one it is the settings' own, else a new one under `runs`.

    Raises:
        InputError: the folder exists or cannot be made.
    """
    from palpate.report.writing import write_all
    from palpate.runs.files import write_files

    folder = folder or made.settings.out or default_folder(_name(made.settings))
    try:
        with new_folder(folder) as scratch:
            write_json(scratch / "request.json", request_json(made.settings))
            write_files(made, scratch, folder)
            shortfalls = write_all(made, scratch, place=folder)
    except OSError as error:
        raise InputError(f"cannot write '{folder}': {error.strerror}") from error
    return replace(made, folder=folder, shortfalls=(*made.shortfalls, *shortfalls))


def reopen(folder: Path) -> Run:
    """The run that `save` wrote into `folder`; its trace is read when first asked for.

    Raises:
        InputError: there is no such folder, or it is not a run's.
    """
    from palpate.runs.read import read_run

    settings = settings_from(read_json(folder / "request.json"))
    return read_run(folder, settings)


def _executed(
    cell: Cell,
    observer: Observer | None,
    progress: Progress,
    keeper: Keeper,
    may_resume: Resume,
    made: Run,
) -> Iterator[Run]:
    made = execute(made, cell, observer, progress, keeper.samples, may_resume)
    keeper.trace(made)
    yield made


def _estimated(cell: Cell | None, progress: Progress, made: Run) -> Iterator[Run]:
    """The run after every estimate, and then with what is true."""
    progress("estimating")
    # The trace is read once, not for every estimate.
    made = replace(made, estimates=(), held_out=None, recorded=made.trace)
    for parameter in made.plan.parameters:
        found = stages.estimate_of(made, parameter)
        made = replace(made, estimates=(*made.estimates, found))
        yield made
    progress("judging them on motions that they were not fitted to")
    made = stages.judged(made)
    yield made
    if cell is not None:
        yield replace(made, truth=stages.truths(made, cell))


def _measured(
    cell: Cell | None, progress: Progress, measured: Measured, made: Run
) -> Iterator[Run]:
    for grown in _estimated(cell, progress, made):
        made = grown
        yield made
    measured(made)


def _twinned(
    keeper: Keeper, progress: Progress, darkroom: Darkroom | None, made: Run
) -> Iterator[Run]:
    planned_in = made.scene
    made = build_twin(made, progress)
    keeper.twin(made)
    yield made
    if darkroom is not None:
        darkroom.begin_stills(made)
    if not made.settings.fast:
        yield touch_twin(made, planned_in, progress)


def _reported(
    keeper: Keeper, progress: Progress, darkroom: Darkroom | None, made: Run
) -> Iterator[Run]:
    if keeper.folder is None:
        return
    from palpate.report.writing import write_all

    progress("writing the report")
    shortfalls = write_all(replace(made, stage=None), keeper.folder, darkroom)
    yield replace(made, shortfalls=(*made.shortfalls, *shortfalls))


@contextmanager
def _pictures_of(made: Run) -> Generator[Darkroom | None]:
    """The film of the execution in the making, where there is to be one, and later the pictures, while
    estimates and twin are made."""
    if made.folder is None or made.footage is None or made.settings.fast:
        yield None
        return
    from palpate.report.writing import Darkroom

    with Darkroom(made.footage, made.trace) as darkroom:
        yield darkroom


@contextmanager
def _before_anything_moves(doing: str) -> Generator[None]:
    """A signal that comes now is told as an `ExecutionAborted`."""
    try:
        with interrupts() as signals, signals.raised():
            yield
    except KeyboardInterrupt:
        raise ExecutionAborted(f"interrupted while {doing}; nothing has moved") from None


def _unfailing(tell: Callable[[T], None]) -> Callable[[T], None]:
    """Telling how far a run is may fail, e.g. on a terminal that is gone: no stage does."""

    def told(what: T) -> None:
        # Printing to a closed pipe may raise SystemExit (rich does).
        with suppress(Exception, SystemExit):
            tell(what)

    return told


def _name(settings: Settings) -> str:
    """What a run folder is named after."""
    return settings.scene.resolve().parent.name if settings.scene else ""
