"""The fifth stage: what the trace says of each parameter."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace

import numpy as np

from palpate.callbacks import SILENT, RunCallbacks
from palpate.cells.cell import Cell
from palpate.errors import InputError, PalpateError
from palpate.estimation.estimate import Estimate
from palpate.mjcf.body import Body
from palpate.parameter import Parameter
from palpate.quantities.estimators import estimate_all, failed
from palpate.runs.run import Run
from palpate.scene.raised import as_measured
from palpate.stages.workplace import truths
from palpate.twin.held_out.judge import held_out, with_tests
from palpate.twin.held_out.judged import HeldOut

MADE_UP = "Simulated: the true value was drawn from priors, and is that of no real thing."


def estimate(made: Run, cell: Cell | None, callbacks: RunCallbacks = SILENT) -> Run:
    """From a trace to estimates; what is true is asked when they are made, never before."""
    for grown in estimates(made, cell, callbacks):
        made = grown
    return made


def estimates(made: Run, cell: Cell | None, callbacks: RunCallbacks = SILENT) -> Iterator[Run]:
    """The run after every estimate, after their judgement, and then with what is true."""
    callbacks.progress("estimating")
    # The trace is read once, not for every estimate.
    made = replace(made, estimates=(), held_out=None, recorded=made.trace_if_any)
    bodies = (
        made.scene.bodies
        if made.trace_if_any is None
        else as_measured(made.scene, made.trace_if_any).bodies
    )
    for parameter in made.plan.parameters:
        found = _estimate_of(made, parameter, bodies)
        made = replace(made, estimates=(*made.estimates, found))
        yield made
    callbacks.progress("judging them on motions that they were not fitted to")
    made = _judged(made)
    yield made
    if cell is not None:
        yield replace(made, truth=truths(made, cell))


def reestimate(made: Run, choice: Mapping[str, str] | None = None) -> Run:
    """The run with its estimates made anew from its trace, in memory and without a twin: nothing
    moves, and its folder stays as it is. `choice` names estimators by quantity.

    Raises:
        InputError: it has no trace, another version recorded it, its scene's file is gone, or there is
            no such estimator.
    """
    if made.folder is not None:
        from palpate.runs.read import require_own_version

        require_own_version(made.folder)
    trace = made.trace_if_any
    if trace is None:
        where = "this run" if made.folder is None else f"'{made.folder}'"
        raise InputError(f"{where} has no trace to make estimates of: nothing was executed")
    _require_scene(made)
    bodies = as_measured(made.scene, trace).bodies
    found = estimate_all(made.plan.parameters, trace, bodies, choice or {})
    told = tuple(_told(made, estimate) for estimate in found)
    again = replace(made, recorded=trace, estimates=told, held_out=None, finished=None)
    return _judged(again, choice)


def with_views(made: Run) -> Run:
    """Add what was fitted to the estimates of a run that was read from its folder, by making them
    again from its trace; without a trace or a scene, or where a value differs, they stay as they are."""
    if (
        made.trace_if_any is None
        or not made.scene.bodies
        or any(one.views for one in made.estimates)
    ):
        return made
    with suppress(PalpateError):
        wanted = [one.parameter for one in made.estimates]
        bodies = as_measured(made.scene, made.trace_if_any).bodies
        found = estimate_all(wanted, made.trace_if_any, bodies)
        pairs = zip(made.estimates, found, strict=True)
        same = [
            replace(one, views=again.views) if np.array_equal(one.values, again.values) else one
            for one, again in pairs
        ]
        return replace(made, recorded=made.trace_if_any, estimates=tuple(same))
    return made


def _require_scene(made: Run) -> None:
    """A run read back from its folder has an empty scene where the file is gone."""
    file = made.settings.scene
    if file is not None and not made.scene.bodies:
        raise InputError(
            f"the run's scene, '{file}', is gone: put it back there to make estimates anew"
        )


def _estimate_of(made: Run, parameter: Parameter, bodies: Mapping[str, Body]) -> Estimate:
    """The estimate of a parameter from the run's trace, whatever goes wrong on the way."""
    if made.trace_if_any is None:
        return failed(parameter, "Nothing was recorded.")
    try:
        found = estimate_all([parameter], made.trace_if_any, bodies)[0]
        return _told(made, found)
    except PalpateError as error:
        return failed(parameter, f"There is no estimator: {error}.")


def _told(made: Run, estimate: Estimate) -> Estimate:
    """The estimate, which says what it is not: in the twin, too, where nothing else does."""
    estimate = made.settings.within.told(estimate)
    if not made.drawn:
        return estimate
    return replace(estimate, method=f"{estimate.method} {MADE_UP}".lstrip())


def _judged(made: Run, choice: Mapping[str, str] | None = None) -> Run:
    """The run with its estimates judged on motions that they were not fitted to, made again by the
    estimators that `choice` names."""
    if made.trace_if_any is None:
        return made
    try:
        held = held_out(
            as_measured(made.scene, made.trace_if_any), made.trace_if_any, made.estimates, choice
        )
    except Exception as error:
        reason = f"nothing was held out: {type(error).__name__}: {error}"
        return replace(made, held_out=HeldOut((), (reason,)))
    if held is None:
        return made
    return replace(made, held_out=held, estimates=with_tests(made.estimates, held))
