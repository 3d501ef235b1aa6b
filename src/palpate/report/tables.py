"""Known and unknown values of the scene, as rows of a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from palpate.parameter import Parameter
from palpate.quantities.catalogue import catalogue
from palpate.report.data import Measured, ParameterRow
from palpate.report.evidence.windows import quantity_label
from palpate.report.numbers import plain, with_unit
from palpate.runs.figures import in_a_line

UNSTATED = {"known": "–", "missing": "?", "assumed": "as of uniform density"}
"""Placeholder for a missing value."""


@dataclass(frozen=True, slots=True)
class Row:
    """A parameter in words, with its value before and after as text."""

    quantity: str
    state: str
    value: str
    asked: bool


def parameter_groups(
    rows: Sequence[ParameterRow], measured: Sequence[Measured]
) -> dict[str, list[Row]]:
    """Rows by the object they are about."""
    found: dict[Parameter, Measured] = {}
    for m in measured:
        if m.estimate.verdict in ("identified", "prior-dominated"):
            found[stated_as(m.estimate.parameter)] = m
    groups: dict[str, list[Row]] = {}
    for row in rows:
        shown = Row(quantity_label(row.quantity), row.state, _value(row, found), row.asked)
        groups.setdefault(row.object, []).append(shown)
    return groups


def stated_as(parameter: Parameter) -> Parameter:
    """The parameter under which the scene states it: a `com_3d` is a `com`."""
    quantity = catalogue().get(parameter.quantity)
    if quantity is None:
        return parameter
    return Parameter(parameter.object, quantity.known_as())


def _value(row: ParameterRow, found: Mapping[Parameter, Measured]) -> str:
    """Value of the scene, followed by an arrow and the measured one."""
    unit = catalogue()[row.quantity].unit if row.quantity in catalogue() else ""
    before = plain(row.value) if row.value else UNSTATED[row.state]
    now = found.get(Parameter(row.object, row.quantity))
    if now is not None:
        return with_unit(f"{before} → {in_a_line(now.estimate)}", unit)
    if row.value:
        return with_unit(before, unit)
    return before
