"""Contract and registry of estimators, and estimation of the parameters of a plan."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cache
from importlib import import_module
from typing import Protocol

import numpy as np

from palpate.common.errors import InputError, unknown_name
from palpate.common.extensions import Registry, references
from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Estimate, not_identified
from palpate.estimation.evidence import remove_spoiled, select_evidence, spoiled_spans
from palpate.estimation.quantities.catalogue import catalogue
from palpate.mjcf.body import Body
from palpate.trace.recording import RECORDED
from palpate.trace.samples import Trace


class Estimator(Protocol):
    """Function that estimates one quantity from a trace and no other measurement.

    It looks up its recordings in the trace. `trace.converted(parameter)` is the recording that a conversion
    declared for the parameter; `trace.recordings` are all of them with their context. Without evidence it returns
    `not_measured` or `not_identified`, with the reason.
    """

    def __call__(self, trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
        """Estimate a parameter.

        Args:
            trace: samples, leaves and recordings, without the truth of a simulated world.
            parameter: parameter to estimate, of this estimator's quantity.
            body: statements of the scene about the parameter's object; None if it is not a body of the scene
                (the gripper).

        Raises:
            ValueError: A recording is no evidence: it has no samples, or differs from its declaration.
        """
        ...


Reference = str
"""`package.module:function` of an estimator, imported on use."""


def load_estimator(reference: Reference) -> Estimator:
    """Import the estimator of a reference. Raises InputError: it cannot be imported; the message names it."""
    module, _, function = reference.partition(":")
    try:
        return getattr(import_module(module), function)
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        raise InputError(
            f"the estimator '{reference}' cannot be loaded: {reason}; "
            "repair or uninstall the package that brings it"
        ) from error


# Registry of estimators, and estimates of a plan's parameters from the trace


ENTRY_POINTS = "palpate.estimators"
RECORDING = "recording"


class Estimators(Registry[Mapping[str, Reference]]):
    """References to estimators by quantity and name; the first of a quantity is its default."""

    kind = "quantity"

    def names(self, quantity: str) -> tuple[str, ...]:
        """Names of the estimators of a quantity, the default first; empty without any."""
        return tuple(self.get(quantity, {}))

    def load(self, quantity: str, name: str | None = None) -> Estimator:
        """Load the estimator `name` of a quantity, or its default.

        Raises InputError: there is none of that name, or it cannot be imported.
        """
        names = self.names(quantity)
        chosen = name or next(iter(names), "")
        if chosen not in names:
            raise unknown_name(f"estimator of {quantity}", chosen, names)
        return load_estimator(self[quantity][chosen])


@cache
def known_estimators() -> Estimators:
    """All installed estimators: those declared by the catalogue's quantities, then those of entry points."""
    found = {id: dict(quantity.estimators) for id, quantity in catalogue().items()}
    for entry, reference in references(ENTRY_POINTS).items():
        quantity, _, name = entry.partition(".")
        found.setdefault(quantity, {}).setdefault(name, reference)
    return Estimators(found)


def estimate_all(
    parameters: Iterable[Parameter],
    trace: Trace,
    bodies: Mapping[str, Body],
    choice: Mapping[str, str] | None = None,
    estimators: Estimators | None = None,
) -> tuple[Estimate, ...]:
    """Estimate every parameter, in order, from the valid part of the trace.

    A parameter is `not identified` without a recording, or if its estimator fails. The same holds if its evidence was
    incomplete when an action failed or was aborted (`palpate.trace.samples`).

    Args:
        parameters: parameters of the plan.
        trace: trace of the whole run.
        bodies: bodies of the scene, by name.
        choice: names of estimators by quantity; other quantities use their default.
        estimators: registry; by default all installed ones.

    Raises:
        InputError: `choice` names an unknown estimator, and the message lists the valid ones; or one cannot be
            imported.
    """
    # Load the chosen estimators first, so that a wrong choice fails before any work.
    known = estimators or known_estimators()
    chosen = choice or {}
    loaded = {quantity: known.load(quantity, name) for quantity, name in chosen.items()}
    evidence = remove_spoiled(trace)
    found: list[Estimate] = []
    for parameter in parameters:
        quantity = parameter.quantity
        if not known.names(quantity):
            found.append(failed_estimate(parameter, f"No estimator of {quantity} is known."))
            continue
        if quantity not in loaded:
            loaded[quantity] = known.load(
                quantity, estimator_for_recording(trace, known.names(quantity))
            )
        # An estimator sees only the part of the trace around its object.
        body = bodies.get(parameter.object)
        part = select_evidence(evidence, parameter.object)
        estimate = guarded_estimate(loaded[quantity], part, parameter, body)
        found.append(estimate if evidence is trace else judge_evidence(estimate, evidence, trace))
    return tuple(found)


def estimator_for_recording(trace: Trace, names: tuple[str, ...]) -> str | None:
    """Name of the estimator for recordings by other programs, if the trace is one and `names` contains it."""
    is_one = any(conversion.primitive == RECORDED for conversion in trace.conversions)
    return RECORDING if is_one and RECORDING in names else None


def failed_estimate(parameter: Parameter, reason: str) -> Estimate:
    """Estimate without a value, with the reason."""
    known = catalogue().get(parameter.quantity)
    return not_identified(parameter, known.unit if known else "1", reason)


def guarded_estimate(
    estimator: Estimator, trace: Trace, parameter: Parameter, body: Body | None
) -> Estimate:
    """Call an estimator and apply the quantity's physical bounds; a failure affects this parameter only."""
    try:
        found = estimator(trace, parameter, body)
    except Exception as error:
        return failed_estimate(parameter, f"Its estimator failed, {type(error).__name__}: {error}.")
    # Reject values that are not finite, then apply the physical bounds.
    numbers = (found.values, found.stds, found.intervals)
    if not all(np.isfinite(part).all() for part in numbers):
        return failed_estimate(parameter, "Not every number that was recorded for it is finite.")
    quantity = catalogue().get(parameter.quantity)
    return found if quantity is None else found.bounded(quantity.bounds)


def judge_evidence(found: Estimate, evidence: Trace, trace: Trace) -> Estimate:
    """Judge an estimate of an aborted run: it loses its value if its evidence was incomplete."""
    action = spoiled_spans(trace)[0].spoiled_by.label
    reason = f"What was recorded in {action} and after is no evidence: it did not end well."
    if not found.has_value:
        return failed_estimate(found.parameter, f"{found.method} {reason}")
    # Keep the value if the valid recordings contain all evidence, or enough for some components.
    quantity = catalogue().get(found.parameter.quantity)
    logged = [(recording.buffer, recording.context) for recording in evidence.recordings]
    if quantity is None or quantity.is_evidenced(found.parameter, logged):
        return found
    if quantity.is_told_in_part(found.parameter, logged):
        return replace(found, method=f"{found.method} {reason}")
    return failed_estimate(found.parameter, f"Its evidence was not complete. {reason}")
