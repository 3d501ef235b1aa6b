"""From values of quantities to changes of the file.

One set of rules serves the model that is simulated (changes made to a parsed copy) and the twin
(the same changes made to the user's text), so both mean the same. Each quantity says what states
it; what they say of one object's `<inertial>` is put together in `mjcf.inertial`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from palpate.errors import InputError
from palpate.mjcf.body import BodyDescription
from palpate.mjcf.edits import Change
from palpate.mjcf.inertial import Statement, written
from palpate.parameter import Parameter
from palpate.quantities.catalogue import Catalogue
from palpate.quantities.quantity import Prior, Values

Bodies = Mapping[str, BodyDescription]


def changes(
    bodies: Bodies,
    catalogue: Catalogue,
    values: Values,
    known: Values,
    std: Mapping[Parameter, float],
) -> Iterator[Change]:
    """The changes that state `values`; `known` holds what they rest on but leave alone, `std`
    standard deviations, which decide how many digits are written.

    Raises:
        InputError: a value for what the scene does not have, or for what has no place in the file.
    """
    for name in dict.fromkeys(parameter.object for parameter in values):
        body = _body(bodies, catalogue, name, values)
        statements, others = _stated(body, catalogue, values, std)
        rests_on, _ = _stated(body, catalogue, known, {})
        yield from written(body, statements, rests_on)
        yield from others
    believed = {**known, **values}
    for body in bodies.values():
        for quantity in catalogue.of(body.role):
            yield from quantity.follows(body, believed)


def _body(bodies: Bodies, catalogue: Catalogue, name: str, values: Values) -> BodyDescription:
    """The body of that name, which has one of the quantities that `values` say of it."""
    ids = [parameter.quantity for parameter in values if parameter.object == name]
    body = bodies.get(name)
    if body is not None:
        for quantity in catalogue.of(body.role):
            if body.role == "object" or quantity.id in ids:
                return body
    raise InputError(f"no object or surface '{name}' of the scene has a {' or '.join(ids)}")


def _stated(
    body: BodyDescription, catalogue: Catalogue, values: Values, std: Mapping[Parameter, float]
) -> tuple[list[Statement], list[Change]]:
    """Statements of its quantities, in the catalogue's order: of the `<inertial>`, and of
    everything else."""
    statements: list[Statement] = []
    others: list[Change] = []
    for quantity in catalogue.of(body.role):
        parameter = Parameter(body.name, quantity.id)
        if parameter not in values:
            continue
        for change in quantity.write(body, values[parameter], std.get(parameter)):
            if isinstance(change, Statement):
                statements.append(change)
            else:
                others.append(change)
    return statements, others


def beliefs(bodies: Bodies, catalogue: Catalogue) -> dict[Parameter, Prior]:
    """Priors of everything missing: of surfaces first, then of the objects on them."""
    found: dict[Parameter, Prior] = {}
    means: dict[Parameter, tuple[float, ...]] = {}
    for role in ("surface", "object"):
        for body in bodies.values():
            if body.role != role:
                continue
            for quantity in catalogue.of(role):
                if quantity.status(body) == "missing":
                    prior = quantity.prior(body, means)
                    parameter = Parameter(body.name, quantity.id)
                    found[parameter], means[parameter] = prior, prior.mean
    return found


def completed(
    bodies: Bodies, catalogue: Catalogue, priors: Values, values: Values
) -> dict[Parameter, tuple[float, ...]]:
    """`values`, and for the other parameters of `priors` what is believed once those are known."""
    merged = {**priors, **values}
    for parameter in merged:
        if parameter not in values:
            quantity = catalogue[parameter.quantity]
            merged[parameter] = quantity.prior(bodies[parameter.object], merged).mean
    return merged
