"""Comparison of several runs on the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate.cli.console import escape, out, print_json
from palpate.cli.show.estimates import COLUMNS, estimate_rows
from palpate.cli.show.layout import Column, print_rows
from palpate.runs.figures import rounded_columns

if TYPE_CHECKING:
    from palpate.runs.several.compare import Comparison, Row

NAME, VALUE, _, VERDICT = COLUMNS
COMPARED = (
    NAME,
    Column("run", words=True),
    VALUE,
    Column("difference ± std"),
    Column("in stds", right=True),
    VERDICT,
)
FAR = 1.96
"""Standard deviations that chance exceeds in 5 % of differences; larger ones are highlighted."""


def show_comparison(comparison: Comparison, as_json: bool) -> None:
    """Print a row for every run and component, with its difference from the first run."""
    from palpate.runs.several.compare import comparison_json

    if as_json:
        print_json(comparison_json(comparison))
        return
    every = [row for of in comparison.rows.values() for row in of]
    rows = [cells for row in every for cells in _cells(row)]
    if not rows:
        out.print("none of these runs made an estimate")
    elif all(row.estimate is None or row.estimate.identified for row in every):
        print_rows(COMPARED[:-1], [row[:-1] for row in rows])
    else:
        print_rows(COMPARED, rows)
    if any(row.z is not None for row in every):
        out.print(
            "[dim]Differences are from the first run; what runs share is not in their std.[/]"
        )
    for remark in comparison.remarks:
        out.prose(f"[yellow]note[/] {escape(remark)}")


def _cells(row: Row) -> list[list[str]]:
    if row.estimate is None:
        return []
    apart = _apart(row)
    cells: list[list[str]] = []
    for place, (name, value, _, verdict) in enumerate(estimate_rows(row.estimate)):
        cells.append([name, escape(row.run), value, *apart.get(place, ("", "")), verdict])
    return cells


def _apart(row: Row) -> dict[int, tuple[str, str]]:
    """Difference, and difference in standard deviations, by component."""
    if row.difference is None or row.std is None or row.z is None:
        return {}
    values, stds = rounded_columns(row.difference, row.std)
    found: dict[int, tuple[str, str]] = {}
    for place, z in enumerate(row.z.tolist()):
        sign = "" if values[place].startswith("-") else "+"
        far = f"[bold yellow]{z:+.1f}[/]" if abs(z) > FAR else f"{z:+.1f}"
        found[place] = (f"{sign}{values[place]} ± {stds[place]}", far)
    return found
