"""Registry of estimators, and the estimates of a plan's parameters from the trace.

A quantity names its estimators: `estimators = {"contrast": "palpate.quantities.mass:estimate_mass",
…}`, the default first. A third party adds one to a known quantity through the entry-point group
`palpate.estimators`; the entry's name is `quantity.name`, its value the function:

    [project.entry-points."palpate.estimators"]
    "mass.mine" = "my_package:estimate_mass"

All of them have the contract of `palpate.estimation.estimator.Estimator`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from palpate.errors import unknown_name
from palpate.estimation.estimate import Estimate, not_identified
from palpate.estimation.estimator import Estimator, Reference, load_estimator
from palpate.extensions import references
from palpate.mjcf.body import Body
from palpate.parameter import Parameter
from palpate.quantities.catalogue import catalogue
from palpate.trace.around import around
from palpate.trace.recording import RECORDED
from palpate.trace.samples import Trace
from palpate.trace.soundness import sound, spoiled

ENTRY_POINTS = "palpate.estimators"
RECORDING = "recording"


@dataclass(frozen=True, slots=True)
class Estimators:
    """References to estimators by quantity and name; the first of a quantity is its default."""

    references: Mapping[str, Mapping[str, Reference]]

    def names(self, quantity: str) -> tuple[str, ...]:
        """Names of the estimators of a quantity, the default first; empty without any."""
        return tuple(self.references.get(quantity, {}))

    def load(self, quantity: str, name: str | None = None) -> Estimator:
        """Load the estimator `name` of a quantity, or its default.

        Raises:
            InputError: there is none of that name, or it cannot be loaded.
        """
        names = self.names(quantity)
        chosen = name or next(iter(names), "")
        if chosen not in names:
            raise unknown_name(f"estimator of {quantity}", chosen, names)
        return load_estimator(self.references[quantity][chosen])


@cache
def known_estimators() -> Estimators:
    """All installed estimators: those that the catalogue's quantities name, then those of the entry
    points."""
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
    """Estimate every parameter, in order, from the sound part of the trace.

    A parameter is `not identified` if nothing was recorded for it, if its evidence was not complete when
    an action failed or was aborted (`palpate.trace.soundness`), or if its estimator fails.

    Args:
        parameters: parameters of the plan.
        trace: of the whole run.
        bodies: of the scene, by name.
        choice: names of estimators by quantity; others use the default.
        estimators: registry; by default all that are installed.

    Raises:
        InputError: `choice` names an unknown estimator; the message lists the valid ones. Or one
            cannot be loaded.
    """
    known = estimators or known_estimators()
    chosen = choice or {}
    loaded = {quantity: known.load(quantity, name) for quantity, name in chosen.items()}
    evidence = sound(trace)
    found: list[Estimate] = []
    for parameter in parameters:
        quantity = parameter.quantity
        if not known.names(quantity):
            found.append(failed(parameter, f"No estimator of {quantity} is known."))
            continue
        if quantity not in loaded:
            loaded[quantity] = known.load(quantity, recorded(trace, known.names(quantity)))
        body = bodies.get(parameter.object)
        part = around(evidence, parameter.object)
        estimate = guarded_estimate(loaded[quantity], part, parameter, body)
        found.append(estimate if evidence is trace else judged(estimate, evidence, trace))
    return tuple(found)


def recorded(trace: Trace, names: tuple[str, ...]) -> str | None:
    """Name of the estimator for recordings by other programs, where the trace is one and `names` has it."""
    is_one = any(conversion.primitive == RECORDED for conversion in trace.conversions)
    return RECORDING if is_one and RECORDING in names else None


def failed(parameter: Parameter, reason: str) -> Estimate:
    """Return an estimate without a value, with the reason."""
    known = catalogue().get(parameter.quantity)
    return not_identified(parameter, known.unit if known else "1", reason)


def guarded_estimate(
    estimator: Estimator, trace: Trace, parameter: Parameter, body: Body | None
) -> Estimate:
    """Call an estimator and apply the quantity's physical bounds. Its failure affects this parameter only."""
    try:
        found = estimator(trace, parameter, body)
    except Exception as error:
        return failed(parameter, f"Its estimator failed, {type(error).__name__}: {error}.")
    numbers = (found.values, found.stds, found.intervals)
    if not all(np.isfinite(part).all() for part in numbers):
        return failed(parameter, "Not every number that was recorded for it is finite.")
    quantity = catalogue().get(parameter.quantity)
    return found if quantity is None else found.bounded(quantity.bounds)


def judged(found: Estimate, evidence: Trace, trace: Trace) -> Estimate:
    """Judge an estimate of an aborted run: without a value if its evidence was not complete."""
    action = spoiled(trace)[0].spoiled_by.label
    reason = f"What was recorded in {action} and after is no evidence: it did not end well."
    if not found.has_value:
        return failed(found.parameter, f"{found.method} {reason}")
    quantity = catalogue().get(found.parameter.quantity)
    logged = [(recording.buffer, recording.context) for recording in evidence.recordings]
    if quantity is None or quantity.is_evidenced(found.parameter, logged):
        return found
    if quantity.is_told_in_part(found.parameter, logged):
        return replace(found, method=f"{found.method} {reason}")
    return failed(found.parameter, f"Its evidence was not complete. {reason}")
