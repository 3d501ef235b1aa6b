"""Tick the behavior tree on the cell's robot, and record the trace."""

from __future__ import annotations

import logging
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from palpate.callbacks import SILENT, RunCallbacks
from palpate.cells.cell import Cell
from palpate.errors import InputError
from palpate.execution.recovery import OnFailure
from palpate.planning.plan import Plan
from palpate.quantities.within import Within
from palpate.robots.robot import Remembering, Robot
from palpate.runs.run import Ending, Run
from palpate.scene.scene import Scene
from palpate.stages.watching import See, eye, watched
from palpate.stages.workplace import footage_of, robot_of
from palpate.vocabulary.base import Settled, as_believed

if TYPE_CHECKING:
    from palpate.execution.runner import Execution, Keep

log = logging.getLogger(__name__)


def execute(
    made: Run, cell: Cell, callbacks: RunCallbacks = SILENT, keep: Keep | None = None
) -> Run:
    """Execute the plan on the cell's robot; `keep` writes samples to disk meanwhile.

    Raises:
        InputError: the workplace cannot be used.
        Unavailable: the robot, or the camera, is out of reach.
    """
    see = eye(made, cell)
    robot, before = robot_of(cell, callbacks.may_resume)
    callbacks.progress(f"executing on the {'simulated' if cell.simulated else 'real'} robot")
    done = perform(
        made.plan,
        made.scene,
        robot,
        callbacks,
        made.settings.on_failure,
        within=made.settings.within,
        keep=keep,
        real=not cell.simulated,
        settled=as_believed if made.rehearsal is None else made.rehearsal.foresight.settled,
        see=see,
    )
    ending = Ending.of(done)
    return replace(
        made,
        world=cell.description,
        simulated=cell.simulated,
        execution=replace(ending, setbacks=(*before, *ending.setbacks)),
        final_state=done.final_state,
        beliefs=done.final_state.seen,
        recorded=done.trace,
        black_box=robot.black_box() if isinstance(robot, Remembering) else None,
        footage=footage_of(cell),
    )


def perform(
    plan: Plan,
    scene: Scene,
    robot: Robot,
    callbacks: RunCallbacks = SILENT,
    on_failure: OnFailure = "stop",
    *,
    within: Within | None = None,
    keep: Keep | None = None,
    real: bool = False,
    noiseless: bool = False,
    settled: Settled = as_believed,
    see: See | None = None,
    tick_period: float | None = None,
) -> Execution:
    """Run the tree on the robot, and close the robot in any case.

    Args:
        plan: with a tree.
        scene: that the plan was made for.
        robot: simulated or real.
        callbacks: progress, and the confirmation to resume after a stop of a real robot.
        on_failure: `stop`, `skip` the failed object, or `replan`.
        within: half widths of 95 % intervals; a measurement with a wider one is repeated.
        keep: writes samples to disk meanwhile.
        real: the robot is a real one.
        noiseless: the robot is a simulated one without noise.
        settled: corrects the symbolic state after a leaf of the plan, by where things ended in its
            rehearsal.
        see: looks at the scene after motions; a thing that moved ends the run.
        tick_period: s of robot time between two ticks; the runner's by default.
    """
    from palpate.execution.recovery import recover
    from palpate.execution.repetition import repeat
    from palpate.execution.runner import TICK_PERIOD
    from palpate.execution.runner import run as run_tree

    attempt = partial(
        run_tree,
        observer=callbacks.observer,
        keep=keep,
        noiseless=noiseless,
        settled=watched(as_believed, see),
        tick_period=tick_period or TICK_PERIOD,
    )
    try:
        first = attempt(plan, scene, robot, settled=watched(settled, see))
        done = recover(
            first,
            plan,
            scene,
            robot,
            policy=on_failure,
            run=attempt,
            real=real,
            may_resume=callbacks.may_resume,
        )
        if within:
            done = repeat(
                done, plan, scene, robot, within=within, run=attempt, say=callbacks.progress
            )
        return done
    finally:
        try:
            robot.close()
        except Exception as error:  # the measurements are kept all the same
            log.warning("the robot was not closed: %s: %s", type(error).__name__, error)


def cut_off(made: Run) -> Run:
    """End the execution of a run whose process was killed meanwhile, with the trace up to there."""
    try:
        trace = made.trace_if_any
    except InputError:  # the file was cut off too early to be read
        trace = None
    leaves = trace.leaves if trace is not None else ()
    seconds = 0.0
    if trace is not None and len(trace.samples):
        seconds = float(trace.t[-1] - trace.t[0])
    ended_well = sum(leaf.status == "SUCCESS" for leaf in leaves) == made.plan.actions
    ending = Ending(
        "complete" if ended_well else "stopped",
        stopped_by=None if ended_well else "the process ended while the plan was executed",
        actions=len(leaves),
        robot_seconds=seconds,
        wall_seconds=0.0,
    )
    return replace(made, execution=ending, recorded=trace)
