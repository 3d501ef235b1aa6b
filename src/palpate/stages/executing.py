"""The fourth stage: the tree is ticked on the cell's robot, and a trace is what comes of it."""

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
from palpate.stages.workplace import footage_of, robot_of

if TYPE_CHECKING:
    from palpate.execution.runner import Execution, Keep
    from palpate.trace.samples import Trace

log = logging.getLogger(__name__)


def execute(
    made: Run, cell: Cell, callbacks: RunCallbacks = SILENT, keep: Keep | None = None
) -> Run:
    """From a plan to a trace; `keep` writes it down meanwhile.

    Raises:
        InputError: the workplace cannot be used.
        Unavailable: the robot is out of reach.
    """
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
) -> Execution:
    """Run the tree on the robot, which is let go in any case.

    Args:
        plan: what is to be done.
        scene: where.
        robot: what moves.
        callbacks: progress, and the question where a real robot was stopped.
        on_failure: how far it goes on after a failure.
        within: half widths; what is wider is measured again.
        keep: writes down what is sensed meanwhile.
        real: something real moves.
    """
    from palpate.execution.recovery import recover
    from palpate.execution.repetition import repeat
    from palpate.execution.runner import run as run_tree

    attempt = partial(run_tree, observer=callbacks.observer, keep=keep)
    try:
        first = attempt(plan, scene, robot)
        done = recover(first, plan, scene, robot, on_failure, attempt, real, callbacks.may_resume)
        if within:
            done = repeat(done, plan, scene, robot, within, attempt, callbacks.progress)
        return done
    finally:
        _let_go(robot)


def _let_go(robot: Robot) -> None:
    """Close the robot; measurements are kept even where that fails."""
    try:
        robot.close()
    except Exception as error:
        log.warning("the robot was not closed: %s: %s", type(error).__name__, error)


def cut_off(made: Run) -> Run:
    """A run whose process ended while it was executing, with the trace as far as that was written
    down."""
    trace = _readable_trace(made)
    leaves = trace.leaves if trace is not None else ()
    seconds = 0.0
    if trace is not None and len(trace.samples):
        seconds = float(trace.t[-1] - trace.t[0])
    ended_well = sum(leaf.status == "SUCCESS" for leaf in leaves) == made.plan.actions
    ending = Ending(
        "complete" if ended_well else "stopped",
        None if ended_well else "the process ended while the plan was executed",
        len(leaves),
        seconds,
        0.0,
    )
    return replace(made, execution=ending, recorded=trace)


def _readable_trace(made: Run) -> Trace | None:
    try:
        return made.trace_if_any
    except InputError:
        return None
