"""Which estimators there are, and what a plan promised, from the trace.

A quantity names its estimators: `estimators = {"contrast": "palpate.quantities.mass:estimate_mass",
…}`, the default first. A third party adds one to a known quantity through the entry-point group
`palpate.estimators`; the entry's name is `quantity.name`, its value the function:

    [project.entry-points."palpate.estimators"]
    "mass.mine" = "my_package:estimate_mass"

All of them keep to one contract, `palpate.estimation.estimator.Estimator`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache

from palpate.errors import unknown_name
from palpate.estimation.estimate import Estimate, not_identified
from palpate.estimation.estimator import Estimator, Reference, load_estimator
from palpate.extensions import references
from palpate.mjcf.body import Body
from palpate.parameter import Parameter
from palpate.quantities.catalogue import catalogue
from palpate.trace.samples import Trace

ENTRY_POINTS = "palpate.estimators"


@dataclass(frozen=True, slots=True)
class Estimators:
    """References to estimators by quantity and name; the first of a quantity is its default."""

    references: Mapping[str, Mapping[str, Reference]]

    def names(self, quantity: str) -> tuple[str, ...]:
        """Of the estimators of a quantity, the default first; empty when there are none."""
        return tuple(self.references.get(quantity, {}))

    def load(self, quantity: str, name: str | None = None) -> Estimator:
        """The estimator `name` of a quantity, or its default.

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
    """Everything installed: the estimators that the catalogue's quantities name, and after them
    those of the entry points."""
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
    """An estimate for every parameter, in order, from the whole trace.

    A parameter that nothing was recorded for is `not identified`.

    Args:
        parameters: what the plan promised.
        trace: of the whole run.
        bodies: of the scene, by name.
        choice: names of estimators by quantity; the default where none is chosen.
        estimators: those to choose from; by default all that are known.

    Raises:
        InputError: `choice` names an unknown estimator; the message lists the valid ones.
    """
    known = estimators or known_estimators()
    chosen = choice or {}
    loaded = {quantity: known.load(quantity, name) for quantity, name in chosen.items()}
    found: list[Estimate] = []
    for parameter in parameters:
        quantity = parameter.quantity
        if not known.names(quantity):
            found.append(_unknown(parameter))
            continue
        if quantity not in loaded:
            loaded[quantity] = known.load(quantity)
        found.append(loaded[quantity](trace, parameter, bodies.get(parameter.object)))
    return tuple(found)


def _unknown(parameter: Parameter) -> Estimate:
    known = catalogue().get(parameter.quantity)
    unit = known.unit if known else "1"
    return not_identified(parameter, unit, f"No estimator of {parameter.quantity} is known.")
