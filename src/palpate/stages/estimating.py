"""Estimate each parameter from the trace, and validate the estimates on held-out motions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np

from palpate.beside import shared_out
from palpate.callbacks import SILENT, RunCallbacks
from palpate.cells.cell import Cell
from palpate.errors import InputError, PalpateError
from palpate.estimation.estimate import Estimate
from palpate.parameter import Parameter
from palpate.quantities.estimators import estimate_all, failed
from palpate.runs.run import Run
from palpate.scene.raised import as_measured, corrected
from palpate.scene.scene import Scene
from palpate.stages.workplace import truths
from palpate.trace.samples import Trace
from palpate.twin.held_out.judge import held_out, with_tests
from palpate.twin.held_out.judged import HeldOut

MADE_UP = "Simulated: the true value was drawn from priors, and is that of no real thing."


def estimate(made: Run, cell: Cell | None, callbacks: RunCallbacks = SILENT) -> Run:
    """Return the run with its estimates, validated, and with the truth where `cell` knows it."""
    for grown in estimates(made, cell, callbacks):
        made = grown
    return made


def estimates(made: Run, cell: Cell | None, callbacks: RunCallbacks = SILENT) -> Iterator[Run]:
    """Yield the run after every estimate, after their validation, and then with the truth."""
    callbacks.progress("estimating")
    trace = made.trace_if_any
    # Keep the trace, so that it is read from its file once and not for every estimate.
    made = replace(made, estimates=(), held_out=None, recorded=trace)
    scene = made.scene if trace is None else _as_felt(made, trace)
    for found in shared_out(partial(_estimated, made, scene), made.plan.parameters):
        made = replace(made, estimates=(*made.estimates, found))
        yield made
    callbacks.progress("validating the estimates on held-out motions")
    made = _validated(made, scene)
    yield made
    # The truth is asked for when the estimates are final, never before.
    if cell is not None:
        yield replace(made, truth=truths(made, cell))


def _as_felt(made: Run, trace: Trace) -> Scene:
    """The run's scene with its surfaces as measured, and its objects where touch found them."""
    scene = as_measured(made.scene, trace)
    for name, belief in made.beliefs.items():
        if belief.is_moved and name in scene.bodies:
            scene = corrected(scene, name, belief.placed @ belief.seen.inverse())
    return scene


def _estimated(made: Run, scene: Scene, parameter: Parameter) -> Estimate:
    """The estimate of a parameter, with the surfaces of `scene` as measured."""
    trace = made.trace_if_any
    if trace is None:
        return failed(parameter, "Nothing was recorded.")
    try:
        return _annotated(made, estimate_all([parameter], trace, scene.bodies)[0])
    except PalpateError as error:
        return failed(parameter, f"There is no estimator: {error}.")


def reestimate(made: Run, choice: Mapping[str, str] | None = None) -> Run:
    """Make the estimates again from the stored trace, in memory and without a twin: nothing moves,
    and the run's folder stays unchanged. `choice` names estimators by quantity.

    Raises:
        InputError: it has no trace, another version recorded it, its scene's file is missing, or there
            is no such estimator.
    """
    if made.folder is not None:
        from palpate.runs.read import require_own_version

        require_own_version(made.folder)
    trace = made.trace_if_any
    if trace is None:
        where = "this run" if made.folder is None else f"'{made.folder}'"
        raise InputError(f"{where} has no trace to make estimates from: nothing was executed")
    # A run read from its folder has an empty scene if the scene's file is missing.
    file = made.settings.scene
    if file is not None and not made.scene.bodies:
        raise InputError(
            f"the run's scene, '{file}', is missing: put it back there to make estimates again"
        )
    scene = _as_felt(made, trace)
    recorded = [one.parameter for one in made.estimates] if made.is_recorded else ()
    found = estimate_all(recorded or made.plan.parameters, trace, scene.bodies, choice or {})
    annotated = tuple(_annotated(made, estimate) for estimate in found)
    again = replace(made, recorded=trace, estimates=annotated, held_out=None, finished=None)
    return _validated(again, scene, choice)


def with_views(made: Run) -> Run:
    """Add the data of the fits, which a run's folder does not hold, to the estimates of a run that
    was read from its folder, by making them again from its trace. An estimate whose value differs
    stays without; so do all without a trace or a scene."""
    trace = made.trace_if_any
    has_views = any(one.views for one in made.estimates)
    if trace is None or not made.scene.bodies or has_views:
        return made
    with suppress(PalpateError):
        wanted = [one.parameter for one in made.estimates]
        found = estimate_all(wanted, trace, _as_felt(made, trace).bodies)
        same = [
            replace(one, views=again.views) if np.array_equal(one.values, again.values) else one
            for one, again in zip(made.estimates, found, strict=True)
        ]
        return replace(made, recorded=trace, estimates=tuple(same))
    return made


def _annotated(made: Run, estimate: Estimate) -> Estimate:
    """Add to the estimate's method an interval wider than asked for, and a truth drawn from priors."""
    estimate = made.settings.within.told(estimate)
    if not made.drawn:
        return estimate
    # The method's text is all that the twin quotes, so it must say there that no real thing was measured.
    return replace(estimate, method=f"{estimate.method} {MADE_UP}".lstrip())


def _validated(made: Run, scene: Scene, choice: Mapping[str, str] | None = None) -> Run:
    """Test the estimates on held-out motions: each is left out, the rest is fitted again by the
    estimators that `choice` names, and the left-out recording is predicted. `scene`: as measured."""
    trace = made.trace_if_any
    if trace is None:
        return made
    try:
        held = held_out(scene, trace, made.estimates, choice)
    except Exception as error:
        reason = f"nothing was held out: {type(error).__name__}: {error}"
        return replace(made, held_out=HeldOut((), (reason,)))
    if held is None:
        return made
    return replace(made, held_out=held, estimates=with_tests(made.estimates, held))
