"""The third stage: before a real robot moves, the plan is executed in simulation, and a person is
asked."""

from __future__ import annotations

from dataclasses import replace

from palpate.callbacks import SILENT, RunCallbacks
from palpate.cells.cell import Cell
from palpate.errors import ExecutionAborted
from palpate.planning.check.check import Finding
from palpate.runs.run import Run


def rehearse(made: Run, callbacks: RunCallbacks = SILENT) -> Run:
    """A rehearsal where the settings want one; a failure in it is a finding, and a plan with
    findings is not executed."""
    if not made.ready or not _wanted(made):
        return made
    from palpate.execution.rehearsal import rehearse as rehearse_plan

    callbacks.progress("rehearsing in simulation")
    rehearsal = rehearse_plan(made.plan, made.scene)
    callbacks.progress(f"rehearsal: {rehearsal}")
    if rehearsal.failure is None:
        return replace(made, rehearsal=rehearsal)
    failed = Finding.of("tree", "rehearsal", f"in simulation the plan fails: {rehearsal.failure}")
    return replace(made, rehearsal=rehearsal, findings=(failed,))


def _wanted(made: Run) -> bool:
    """True if a rehearsal is wanted: as the settings say, else before a real robot moves."""
    wanted = made.settings.rehearse
    if wanted is None:
        return made.settings.robot is not None
    return wanted


def confirm(made: Run, callbacks: RunCallbacks = SILENT, cell: Cell | None = None) -> None:
    """Ask before a real robot moves, that of `cell` or of the settings; a simulation needs no
    confirmation.

    Raises:
        ExecutionAborted: the plan was not confirmed.
    """
    real = made.settings.robot is not None or (cell is not None and not cell.simulated)
    if real and made.ready and not callbacks.may_move(made):
        raise ExecutionAborted("the plan was not confirmed; nothing has moved")
