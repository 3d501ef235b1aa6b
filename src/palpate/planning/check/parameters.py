"""Rules of what a plan promises: its parameters."""

from __future__ import annotations

from collections.abc import Iterator

from palpate.errors import perhaps
from palpate.parameter import Parameter
from palpate.planning.check.case import Case
from palpate.planning.check.finding import Finding
from palpate.quantities.catalogue import catalogue


def unknown_parameter(case: Case) -> Iterator[Finding]:
    """Parameters name objects or surfaces of the scene and quantities of the catalogue."""
    for path, parameter in _listed(case):
        if parameter.quantity not in catalogue():
            valid = ", ".join(catalogue())
            meant = catalogue().meant(parameter.quantity)
            guess = (
                f" did you mean '{meant}'?" if meant else perhaps(parameter.quantity, catalogue())
            )
            message = f"'{parameter.quantity[:80]}' is not a quantity;{guess} valid: {valid}"
            yield Finding.of(path, "unknown-parameter", message)
        elif not case.exists(parameter):
            assert case.scene is not None
            valid = ", ".join(case.scene.bodies) or "none"
            guess = perhaps(parameter.object, case.scene.bodies)
            message = f"the scene has no '{parameter.object[:80]}';{guess} valid: {valid}"
            yield Finding.of(path, "unknown-parameter", message)


def unmeasurable(case: Case) -> Iterator[Finding]:
    """A parameter is a quantity that can be measured of its object."""
    for path, parameter in _listed(case):
        quantity = catalogue().get(parameter.quantity)
        if quantity is None:
            continue
        if not quantity.identifiable:
            message = (
                f"{parameter} cannot be measured: {quantity.how}; remove it and say so in the "
                "explanation"
            )
            yield Finding.of(path, "unmeasurable", message)
        elif case.scene is not None and not case.is_of_its_kind(parameter):
            role = case.scene.bodies[parameter.object].role
            message = (
                f"{quantity.label} is a quantity of {_a(quantity.subject)}, and "
                f"'{parameter.object}' is {_a(role)}; remove it"
            )
            yield Finding.of(path, "unmeasurable", message)


def duplicate_parameter(case: Case) -> Iterator[Finding]:
    """A parameter is listed once."""
    seen: set[Parameter] = set()
    for path, parameter in _listed(case):
        if parameter in seen:
            message = f"{parameter} is listed twice; list it once"
            yield Finding.of(path, "duplicate-parameter", message)
        seen.add(parameter)


def requested(case: Case) -> Iterator[Finding]:
    """The parameters are those requested, no more and no fewer."""
    if case.requested is None:
        return
    for parameter in case.requested:
        if parameter not in case.plan.parameters:
            message = f"{parameter} is requested and missing; measure it too"
            yield Finding.of("parameters", "requested", message)
    for path, parameter in _listed(case):
        if parameter not in case.requested:
            message = f"{parameter} is not requested; leave it out"
            yield Finding.of(path, "requested", message)


def known_parameter(case: Case) -> Iterator[Finding]:
    """Reject the measurement of known quantities, unless re-measuring is asked for."""
    if case.scene is None or case.remeasure:
        return
    for path, parameter in _listed(case):
        quantity = catalogue().get(parameter.quantity)
        if quantity is None or not quantity.identifiable or not case.is_known(parameter):
            continue
        body = case.scene.bodies[parameter.object]
        if case.is_of_its_kind(parameter):
            stated = ", ".join(f"{value:.6g}" for value in body.known[parameter.quantity])
            message = (
                f"{parameter} is stated by the scene ({stated} {quantity.unit}); remove it and what "
                "measures it"
            )
            yield Finding.of(path, "known", message)


def _a(noun: str) -> str:
    return f"an {noun}" if noun[0] in "aeiou" else f"a {noun}"


def _listed(case: Case) -> Iterator[tuple[str, Parameter]]:
    for i, parameter in enumerate(case.plan.parameters):
        yield f"parameters[{i}]", parameter
