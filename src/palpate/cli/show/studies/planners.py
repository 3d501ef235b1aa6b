"""Trials of planners, beside what was published."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from rich.text import Text

from palpate.cli.console import out, print_json
from palpate.cli.show.layout import Cell, Column, print_rows
from palpate.studies.figures import Rate
from palpate.studies.planners.trials import Record, Row, by_scenario, table

TRIALS = (
    Column("configuration", words=True),
    Column("planner", words=True),
    Column("syntax"),
    Column("valid"),
    Column("success"),
    Column("tokens", right=True),
    Column("US $", right=True),
)
PAPER = Column("paper: syntax, success")


def show_trials(records: Sequence[Record], published: Mapping[str, str], as_json: bool) -> None:
    """Rates with their 95 % Wilson intervals, beside the published syntax and success; where there
    are several scenarios, each of them below."""
    rows = table(records)
    single = by_scenario(records)
    if as_json:
        content = {"rows": [_row_json(row) for row in rows]}
        print_json(content | {"scenarios": [_row_json(row) for row in single]})
        return
    paper = [published.get(row.configuration, "–") for row in rows]
    _show_rows(rows, PAPER, paper)
    if len(single) > len(rows):
        out.print()
        _show_rows(single, Column("scenario", words=True), [row.scenario for row in single])


def _show_rows(rows: Sequence[Row], last: Column, cells: Sequence[str]) -> None:
    """Rows of trials, with one more column."""
    shown: list[list[Cell]] = []
    for row, cell in zip(rows, cells, strict=True):
        shown.append([*_row_cells(row), Text(cell)])
    print_rows([*TRIALS, last], shown)


def _row_cells(row: Row) -> list[Cell]:
    cost = "–"
    if row.cost is not None:
        cost = f"{row.cost:.3f}"
    return [
        row.configuration,
        Text(row.asked),
        str(row.syntax),
        str(row.valid),
        str(row.success or "–"),
        f"{row.tokens:.0f}",
        cost,
    ]


def _row_json(row: Row) -> dict[str, Any]:
    rates: dict[str, Rate] = {"syntax": row.syntax, "valid": row.valid}
    if row.success:
        rates["success"] = row.success
    intervals = {name: rate.interval for name, rate in rates.items()}
    return asdict(row) | {"intervals": intervals}
