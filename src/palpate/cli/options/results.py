"""Options: precision, estimators and form of the result."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.errors import InputError

if TYPE_CHECKING:
    from palpate.quantities.within import Within


AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]
PlanFile = Annotated[
    Path, typer.Argument(metavar="PLAN", help="A plan, a chat's answer, or a run folder.")
]
RunFolder = Annotated[Path, typer.Argument(metavar="RUN", help="A run folder.")]
Widths = Annotated[
    list[str] | None,
    typer.Option(
        "--within",
        metavar="QUANTITY=VALUE",
        help="Half width of the 95 % interval to reach, e.g. mass=1g, com=2mm, friction=0.01, bottle.mass=1g; "
        "may be repeated. Units: kg g mg, m cm mm um, N/m kN/m; SI without one.",
        rich_help_panel="Planner",
    ),
]
EstimatorNames = Annotated[
    list[str] | None,
    typer.Option(
        "--estimator",
        metavar="QUANTITY=NAME",
        help="Estimator of a quantity, e.g. mass=single-shot; may be repeated.",
    ),
]


def by_quantity(option: str, entries: Sequence[str], word: str = "NAME") -> dict[str, str]:
    """Parse the `QUANTITY=WORD` entries of an option, by quantity; `word` is the placeholder in its
    help.

    Raises:
        InputError: an entry that is none.
    """
    found: dict[str, str] = {}
    for entry in entries:
        quantity, equals, said = (part.strip() for part in entry.partition("="))
        if not (quantity and equals and said):
            raise InputError(f"--{option} takes QUANTITY={word}, not '{entry}'")
        found[quantity] = said
    return found


def widths(entries: Sequence[str] | None) -> Within:
    """Parse requested half widths of intervals.

    Raises:
        InputError: not of the form QUANTITY=VALUE, no such quantity or unit, or no positive number.
    """
    from palpate.tools import widths as read

    return read(by_quantity("within", entries or (), "VALUE"))
