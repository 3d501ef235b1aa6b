"""Estimating stage: each parameter from the trace, and validation on held-out motions."""

from __future__ import annotations

import os
import pickle
from collections.abc import Collection, Iterator, Mapping
from contextlib import AbstractContextManager, closing, nullcontext, suppress
from dataclasses import dataclass, replace
from functools import partial
from hashlib import sha256

import numpy as np

from palpate.common.errors import InputError, PalpateError
from palpate.common.parameter import Parameter
from palpate.common.processes import Fork, can_copy, shared_out
from palpate.estimation.estimate import Estimate
from palpate.estimation.evidence import find_evidence_span, remove_spoiled, select_evidence
from palpate.estimation.quantities.estimators import estimate_all, failed_estimate
from palpate.execution.cell import Cell
from palpate.primitives.base import Recorder
from palpate.runs.building import TemplateRun
from palpate.runs.callbacks import SILENT, RunCallbacks
from palpate.runs.held_out import (
    HeldOut,
    HeldOutMotion,
    held_out,
    judge,
    still_recordings,
    with_tests,
)
from palpate.runs.run import Run
from palpate.runs.workplace import truths
from palpate.scene.load import correct_body, scene_with_measurements
from palpate.scene.scene import Scene
from palpate.trace.samples import Trace

DRAWN_TRUTH = "Simulated: the true value was drawn from priors, and is that of no real thing."


def estimate(run: Run, cell: Cell | None, callbacks: RunCallbacks = SILENT) -> Run:
    """Return the run with its estimates, validated, and with the truth where `cell` knows it."""
    for grown in estimates(run, cell, callbacks):
        run = grown
    return run


def estimates(
    run: Run, cell: Cell | None, callbacks: RunCallbacks = SILENT, ahead: Ahead | None = None
) -> Iterator[Run]:
    """Yield the run after every estimate, after their validation, and finally with the truth.

    `ahead` holds estimates that were made during the execution.
    """
    callbacks.progress("estimating")
    trace = run.trace_if_any
    # Keep the trace, so that it is read from its file once and not for every estimate.
    run = replace(run, estimates=(), held_out=None, recorded=trace)
    # Use the surfaces and poses that the run measured.
    scene = run.scene if trace is None else _measured_scene(run, trace)
    estimate_of: dict[Parameter, Estimate] = {}

    def make(later: Collection[str]) -> Iterator[Run]:
        """Make all estimates that do not exist yet, except those of the objects in `later`."""
        wanted = [p for p in run.plan.parameters if p not in estimate_of]
        wanted = [p for p in wanted if p.object not in later]
        for estimate in shared_out(partial(_estimate_parameter, run, scene), wanted):
            estimate_of[estimate.parameter] = estimate
            every = [estimate_of[p] for p in run.plan.parameters if p in estimate_of]
            yield replace(run, estimates=tuple(every))

    # Make the estimates of objects that no copy works on, then collect those of the copies.
    early: Mapping[str, ObjectEstimates] = {}
    if ahead is not None:
        yield from make(later=ahead.begun)
        early = _select_still_valid(ahead.results(), scene, trace)
        estimate_of |= {p.parameter: p for each in early.values() for p in each.estimates}
    yield from make(later=())
    # Judge the complete set, in the plan's order.
    every = [estimate_of[p] for p in run.plan.parameters]
    run = replace(run, estimates=(*every, *_estimates_without_value(run)))
    callbacks.progress("validating the estimates on held-out motions")
    run = _validate(run, scene, early={name: each.motion for name, each in early.items()})
    yield run
    # Read the truth only after all estimates are final.
    if cell is not None:
        yield replace(run, truth=truths(run, cell))


def _estimates_without_value(run: Run) -> Iterator[Estimate]:
    """Make estimates without a value for the requested parameters that the plan does not measure."""
    for failure in run.plan.unmeasured:
        yield from (failed_estimate(parameter, failure.reason) for parameter in failure.parameters)


@dataclass(frozen=True, slots=True)
class ObjectEstimates:
    """Estimates of one object, with its held-out motion."""

    key: bytes  # digest of all data that this was made from
    estimates: tuple[Estimate, ...]  # of its parameters
    # Its held-out motion, or the reason why there is none; None if it was not held still.
    motion: HeldOutMotion | str | None


def judge_object(run: Run, name: str) -> ObjectEstimates | None:
    """Estimate and judge an object by the run's trace.

    None on failure, so that the error occurs and is reported at the end.
    """
    try:
        trace = run.trace
        scene, evidence = (
            _measured_scene(run, trace),
            select_evidence(remove_spoiled(trace), name),
        )
        wanted = [p for p in run.plan.parameters if p.object == name]
        estimates = tuple(_estimate_parameter(run, scene, p) for p in wanted)
        lifted = any(still_recordings(evidence, name))
        motion = judge(scene, evidence, estimates, name, None) if lifted else None
        return ObjectEstimates(_key(scene, evidence, name), estimates, motion)
    except Exception:
        return None


def _select_still_valid(
    early: Mapping[str, ObjectEstimates], scene: Scene, trace: Trace | None
) -> dict[str, ObjectEstimates]:
    """Select the estimates whose evidence is still the same at the end; none of a run that was interrupted."""
    # An execution with a failure changes which recordings count as evidence.
    if trace is None or remove_spoiled(trace) is not trace:
        return {}
    return {
        name: each
        for name, each in early.items()
        if each.key == _key(scene, select_evidence(trace, name), name)
    }


def _key(scene: Scene, evidence: Trace, name: str) -> bytes:
    """Digest of all data for the estimates of an object: its pose and known values in the scene, and its evidence."""
    # Everything that an estimator reads of the object: pose, covariance, known values, recordings.
    body = scene.bodies[name]
    believed = (body.pose_world.vector, body.tipped.vector, body.covariance, dict(body.known))
    return sha256(pickle.dumps((believed, evidence))).digest()


def _measured_scene(run: Run, trace: Trace) -> Scene:
    """Correct the run's scene: surfaces as measured, objects at the poses found by touch."""
    scene = scene_with_measurements(run.scene, trace)
    for name, belief in run.beliefs.items():
        if belief.is_moved and name in scene.bodies:
            scene = correct_body(scene, name, belief.placed @ belief.seen.inverse())
    return scene


def _estimate_parameter(run: Run, scene: Scene, parameter: Parameter) -> Estimate:
    """Estimate a parameter, with the surfaces of `scene` as measured."""
    trace = run.trace_if_any
    if trace is None:
        return failed_estimate(parameter, "Nothing was recorded.")
    try:
        return _annotate(run, estimate_all([parameter], trace, scene.bodies)[0])
    except PalpateError as error:
        return failed_estimate(parameter, f"There is no estimator: {error}.")


def reestimate(run: Run, choice: Mapping[str, str] | None = None) -> Run:
    """Make the estimates again from the stored trace.

    The result is in memory and has no twin. Nothing moves, and the run's folder stays unchanged.
    `choice` names estimators by quantity.

    Raises:
        InputError: the run has no trace, another version recorded it, its scene's file is missing,
            or there is no such estimator.
    """
    if run.folder is not None:
        from palpate.runs.read import require_own_version

        require_own_version(run.folder)
    trace = run.trace_if_any
    if trace is None:
        where = "this run" if run.folder is None else f"'{run.folder}'"
        raise InputError(f"{where} has no trace to make estimates from: nothing was executed")
    # A run read from its folder has an empty scene if the scene's file is missing.
    file = run.settings.scene
    if file is not None and not run.scene.bodies:
        raise InputError(
            f"the run's scene, '{file}', is missing: put it back there to make estimates again"
        )
    # Repeat estimation and validation as the run did them.
    scene = _measured_scene(run, trace)
    recorded = [e.parameter for e in run.estimates] if run.is_recorded else ()
    fresh = estimate_all(recorded or run.plan.parameters, trace, scene.bodies, choice or {})
    annotated = (*(_annotate(run, estimate) for estimate in fresh), *_estimates_without_value(run))
    again = replace(run, recorded=trace, estimates=annotated, held_out=None, finished=None)
    return _validate(again, scene, choice)


def add_views(run: Run) -> Run:
    """Add the data of the fits to the estimates of a run that was read from its folder.

    A folder does not hold these data: the estimates are made again from the trace. An estimate with
    a different value gets none. Without a trace or a scene, no estimate gets any.
    """
    trace = run.trace_if_any
    has_views = any(e.views for e in run.estimates)
    if trace is None or not run.scene.bodies or has_views:
        return run
    with suppress(PalpateError):
        # Attach the views only to equal values.
        wanted = [e.parameter for e in run.estimates]
        fresh = estimate_all(wanted, trace, _measured_scene(run, trace).bodies)
        same = [
            replace(e, views=again.views) if np.array_equal(e.values, again.values) else e
            for e, again in zip(run.estimates, fresh, strict=True)
        ]
        return replace(run, recorded=trace, estimates=tuple(same))
    return run


def _annotate(run: Run, estimate: Estimate) -> Estimate:
    """Note in the estimate's method an interval wider than requested, and a truth drawn from priors."""
    estimate = run.settings.within.told(estimate)
    if not run.drawn:
        return estimate
    # The twin quotes only the method's text, so this text must state that the truth was drawn from
    # priors.
    return replace(estimate, method=f"{estimate.method} {DRAWN_TRUTH}".lstrip())


def _validate(
    run: Run,
    scene: Scene,
    choice: Mapping[str, str] | None = None,
    early: Mapping[str, HeldOutMotion | str | None] | None = None,
) -> Run:
    """Test the estimates on held-out motions. The rest is fitted again, and predicts the left-out recording.

    `scene` has measured surfaces, `choice` estimators by quantity, `early` motions that were judged before.
    """
    trace = run.trace_if_any
    if trace is None:
        return run
    try:
        motions = held_out(scene, trace, run.estimates, choice, early)
    except Exception as error:
        reason = f"nothing was held out: {type(error).__name__}: {error}"
        return replace(run, held_out=HeldOut((), (reason,)))
    if motions is None:
        return run
    return replace(run, held_out=motions, estimates=with_tests(run.estimates, motions))


# Estimates of finished objects, made while the arm handles the next one.


class Ahead:
    """Estimates made by copies of this process, on processors that are idle while a simulated arm moves.

    They are equal to those made at the end. The caller compares the evidence before it uses them
    (`ObjectEstimates.key`).
    """

    def __init__(self, run: Run, replay: Fork[TemplateRun] | None) -> None:
        """Start without estimates; `replay` is a fork that already runs."""
        self._run, self._replay = run, replay
        # Only objects are estimated ahead, each once.
        of_objects = (p.object for p in run.plan.parameters)
        self._due = [name for name in dict.fromkeys(of_objects) if name in run.scene.objects]
        self._copies: dict[str, Fork[ObjectEstimates | None]] = {}
        self._leaves = 0

    @property
    def begun(self) -> Collection[str]:
        """Objects whose estimates are made or in progress."""
        return self._copies.keys()

    def look(self, recorder: Recorder) -> None:
        """Start the estimates of an object whose evidence is complete, after a leaf has ended.

        A further attempt has another recorder. Its evidence is only a part, and no estimate is
        started.
        """
        # Fewer leaves than before: a new attempt has begun.
        if len(recorder.leaves) < self._leaves:
            self._due.clear()
        if len(recorder.leaves) == self._leaves or not self._due:
            return
        self._leaves = len(recorder.leaves)
        now = recorder.leaves[-1].end
        # Start a copy for the first object whose recordings are complete.
        for name in self._due:
            reached = find_evidence_span(recorder, name)
            if reached is not None and reached[1] < now and self._has_free_processor():
                self._due.remove(name)
                snapshot_run = replace(self._run, recorded=recorder.snapshot())
                with suppress(OSError):  # no process to be had
                    self._copies[name] = Fork(partial(judge_object, snapshot_run, name))
                return

    def results(self) -> Mapping[str, ObjectEstimates]:
        """Wait for the estimates that were started, and return them by object."""
        results = {name: copy.result() for name, copy in self._copies.items()}
        return {name: result for name, result in results.items() if result is not None}

    def _has_free_processor(self) -> bool:
        """True if a processor is free in addition to those of the execution and of the copies."""
        working = sum(copy.running for copy in (*self._copies.values(), self._replay) if copy)
        return can_copy() and working < len(os.sched_getaffinity(0)) - 1

    def close(self) -> None:
        """End the copies whose results were not collected."""
        for copy in self._copies.values():
            copy.close()


def estimate_ahead(
    run: Run, cell: Cell, replay: Fork[TemplateRun] | None
) -> AbstractContextManager[Ahead | None]:
    """Make estimates while a simulated arm moves; None with a real one, which needs the processor.

    `replay` is a fork that already runs.
    """
    return closing(Ahead(run, replay)) if cell.simulated else nullcontext()
