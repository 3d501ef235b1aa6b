"""The pipeline: from a request, or an incomplete scene, to a digital twin.

request + scene + pictures ─► parameters ─► plan ─► (check) ─► tree ─ticks─► trace ─► estimates
─► twin + report

The stages are in `planning`, `executing`, `estimating`, `building` and `saving`. This module
defines their order, and the end of an interrupted run.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.common.errors import InputError
from palpate.common.processes import Fork, before_anything_moves, interrupts, release_memory
from palpate.execution.cell import Cell
from palpate.planning.planner import Planner
from palpate.primitives.base import Recorder
from palpate.runs import workplace
from palpate.runs.building import TemplateRun, build_twin, fork_given_execution, touch_twin
from palpate.runs.callbacks import SILENT, RunCallbacks
from palpate.runs.estimating import Ahead, estimate, estimate_ahead, estimates
from palpate.runs.executing import execute
from palpate.runs.folder import check_writable
from palpate.runs.keeper import TRACE_FAILED, Keeper, Step
from palpate.runs.planning import confirm, load, plan, preflight, rehearse
from palpate.runs.run import TRACE, Run, Stage
from palpate.runs.saving import (
    add_footage,
    film_while_moving,
    folder_for,
    render_in_background,
    resume_run,
    save,
    write_report,
)
from palpate.runs.saving import reopen as reopen
from palpate.runs.settings import Settings, request_json
from palpate.runs.workplace import look, require_seen
from palpate.scene.scene import Scene
from palpate.trace.samples import Samples

if TYPE_CHECKING:
    from palpate.perception.film import Reel
    from palpate.runs.report.writing import Darkroom


def run(settings: Settings, callbacks: RunCallbacks = SILENT) -> Run:
    """Carry out a run from settings to a finished run folder.

    Raises:
        InputError: bad input.
        Unavailable: planner or robot out of reach.
        ExecutionAborted: not confirmed, or interrupted before anything moved.
    """
    began = time.perf_counter()
    settings = settings.check_values()
    folder = folder_for(settings)
    check_writable(folder)
    with before_anything_moves("planning"):
        preflight(settings)
        run = prepare(settings, load(settings), callbacks)
    return carry_out(replace(run, begun=began), callbacks, folder=folder)


def prepare(
    settings: Settings,
    scene: Scene | None,
    callbacks: RunCallbacks = SILENT,
    planner: Planner | None = None,
    world: Path | Scene | None = None,
) -> Run:
    """Look, plan and check. A proposed measurement that the user accepts is planned again.

    The camera looks at the simulated `world` if the settings name no file of it. By default the settings name the
    planner.

    Raises:
        InputError: bad input, or the plan touches objects that the camera did not see.
        Unavailable: provider or camera out of reach.
        ExecutionAborted: the look was not confirmed.
    """
    scene, seen = look(settings, scene, callbacks, world)
    callbacks.progress("planning")
    run = plan(settings, scene, planner)
    if run.plan.proposal and callbacks.may_measure(run):
        run = plan(settings.having(measure=run.plan.proposal), scene)
    return require_seen(run, seen)


def carry_out(
    run: Run, callbacks: RunCallbacks = SILENT, cell: Cell | None = None, folder: Path | None = None
) -> Run:
    """Carry out a plan to a finished run, kept in `folder` while it grows, or only in memory.

    A signal during the execution causes a controlled stop, and the recorded data are still
    evaluated. A signal in another stage ends the run at that point. A failure after the first
    motion becomes one of the run's `shortfalls`.

    Raises:
        InputError: bad input, or a folder that cannot be written.
        Unavailable: the robot is out of reach.
        ExecutionAborted: not confirmed, or interrupted before anything moved.
    """
    release_memory()  # of earlier runs in this process
    callbacks = callbacks.unfailing()
    if run.begun is None:
        run = replace(run, begun=time.perf_counter())
    # Rehearse and confirm: an error or a signal here leaves nothing behind.
    with interrupts() as signals:
        with before_anything_moves("rehearsing"):
            run = rehearse(run, callbacks, cell)
            confirm(run, callbacks, cell)
            if not run.ready:
                # A refusal leaves no folder, unless it was named or keeps a dialogue with a model.
                asked = run.settings.out is not None or run.conversation is not None
                is_kept = folder is not None and (asked or run.plan.satisfied)
                return save(run, folder) if is_kept else run
            cell = cell or _cell_of(run)
        # Execute. Replay in the given scene, estimates and film are computed meanwhile.
        run = replace(run, world=cell.description, simulated=cell.simulated)
        keeper = Keeper(folder, signals)
        run = keeper.begin(run, request_json(run.settings))
        with (
            fork_given_execution(run, cell) as given,
            estimate_ahead(run, cell, given) as ahead,
            film_while_moving(run, cell, given) as reel,
        ):
            steps = _Steps(keeper, callbacks, cell, ahead, reel=reel)
            run = keeper.carry_out_execution(steps.execution, run)
            # Evaluate: estimates, twin and report.
            with render_in_background(run, reel) as darkroom:
                return _Steps(keeper, callbacks, cell, ahead, darkroom, given).carry_out_all(run)


def finish(folder: Path, callbacks: RunCallbacks = SILENT, film: bool = False) -> Run:
    """Finish an interrupted or fast run with the data in its folder, and write its report again.

    Camera footage is not kept: a `film` made later is rendered from the trace.
    Raises InputError: there is no such folder, or it is not a run's.
    """
    with interrupts() as signals:
        run, keeper = resume_run(folder), Keeper(folder, signals)
        # The process ended during the execution: write the trace up to then.
        if run.stage == "executing":
            keeper.trace(run)
            run = replace(run, stage="estimating")
        # Nothing can be made again without the trace: keep the stored values and the report.
        try:
            _ = run.trace_if_any
        except InputError as error:
            keeper.note_damage(TRACE, error)
            return keeper.with_shortfalls(run)
        if film:
            run = add_footage(run)
        return _Steps(keeper, callbacks.unfailing()).carry_out_all(run)


def measure(run: Run, callbacks: RunCallbacks = SILENT, cell: Cell | None = None) -> Run:
    """Execute a checked plan and estimate in memory.

    The run takes place in `cell`, else in the cell that the settings name. A plan with findings, or
    without a tree, is rejected: nothing moves. Raises Interrupted: a signal came; the arm has stopped.
    """
    if not run.ready:
        return run
    with interrupts() as signals, signals.raise_in_block():
        cell = cell or _cell_of(run)
        return estimate(execute(run, cell, callbacks), cell, callbacks)


@dataclass(frozen=True, slots=True)
class _Steps:
    """Stages after the first motion, as steps of a keeper: each yields the grown run."""

    keeper: Keeper  # writes the results
    callbacks: RunCallbacks  # progress and confirmation
    cell: Cell | None = None  # of the execution; None if an earlier process executed the plan
    ahead: Ahead | None = None  # estimates that are computed during the execution
    darkroom: Darkroom | None = None  # film and pictures that are being rendered
    given: Fork[TemplateRun] | None = None  # running execution in the scene before the measurement
    reel: Reel | None = None  # film that is being rendered

    def carry_out_all(self, run: Run) -> Run:
        """Carry out all stages after the execution, from the one that is due. A signal ends them."""
        # Stages in their order; a reopened run begins at the one that was interrupted.
        steps: dict[Stage, Step] = {
            "estimating": self.estimates,
            "building the twin": self.twin,
            "writing the report": self.report,
        }
        due = list(steps)
        if run.stage in due:
            due = due[due.index(run.stage) :]
        elif run.stage is None:
            due = due[-1:]
        for stage in due:
            if run.interrupted is not None:
                return run
            run = self.keeper.run_stage(stage, steps[stage], run)
        if run.interrupted is not None:
            return run
        return self.keeper.keep(replace(run, stage=None))

    def execution(self, run: Run) -> Iterator[Run]:
        assert self.cell is not None
        run = execute(run, self.cell, self.callbacks, self._keep)
        self.keeper.trace(run)
        yield run

    def _keep(self, samples: Samples, recorder: Recorder) -> None:
        # A failure of one of these steps must not stop the arm.
        follow, ahead, reel = self.keeper.follow, self.ahead, self.reel
        follow(TRACE_FAILED, lambda: self.keeper.samples(samples, recorder))
        if ahead is not None:
            follow("no estimate was begun while the arm moved", lambda: ahead.look(recorder))
        if reel is not None:
            follow("the film was not begun", lambda: reel.look(samples, recorder.leaves))

    def estimates(self, run: Run) -> Iterator[Run]:
        for grown in estimates(run, self.cell, self.callbacks, self.ahead):
            run = grown
            yield run
        self.callbacks.measured(run)

    def twin(self, run: Run) -> Iterator[Run]:
        # Validate with the scene that the planner knew: `build_twin` may replace it.
        planned_in = run.scene
        run = build_twin(run, self.callbacks)
        self.keeper.twin(run)
        yield run
        if self.darkroom is not None:
            self.darkroom.begin_stills(run)
        if not run.settings.fast:
            yield touch_twin(run, planned_in, self.callbacks, self.given)

    def report(self, run: Run) -> Iterator[Run]:
        if self.keeper.folder is not None:
            self.callbacks.progress("writing the report")
            yield write_report(run, self.keeper.folder, self.darkroom)


def _cell_of(run: Run) -> Cell:
    """The cell that the run's settings name."""
    return workplace.cell_for(run.settings, run.scene, seen=run.seen is not None)
