"""Estimates on the terminal: one line per component, value and error with the same digits."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from palpate.cli.console import escape, out
from palpate.cli.exits import in_flags
from palpate.cli.show.layout import Column, print_rows
from palpate.runs.figures import figures

if TYPE_CHECKING:
    from palpate.estimation.estimate import Estimate
    from palpate.parameter import Parameter

COLUMNS = (
    Column("parameter"),
    Column("value ± std"),
    Column("95 % interval"),
    Column("verdict"),
)
STYLES = {"identified": "green", "prior-dominated": "yellow"}
"""Colours of verdicts; all others are red."""


def show_estimates(
    estimates: Iterable[Estimate], truth: Mapping[Parameter, Sequence[float]] | None = None
) -> None:
    """Print the table, with a column of the truth if it is known, and below it contradictions and the
    reasons for missing values."""
    estimates = tuple(estimates)
    columns, rows = list(COLUMNS), [row for one in estimates for row in estimate_rows(one)]
    if truth:
        columns.append(Column("truth", style="dim"))
        trues = [
            cell for one in estimates for cell in _truth_cells(one, truth.get(one.parameter, ()))
        ]
        rows = [[*row, cell] for row, cell in zip(rows, trues, strict=True)]
    print_rows(columns, rows)
    for estimate in estimates:
        show_objection(estimate)


def show_objection(estimate: Estimate) -> None:
    """Print the contradiction of an estimate, or why it has no value or is prior-dominated, with the axes."""
    name = escape(str(estimate.parameter))
    if estimate.contradiction:
        out.prose(f"[bold red]contradicted[/] {name}: {escape(in_flags(estimate.contradiction))}")
    elif not estimate.has_value:
        out.prose(f"[bold red]not identified[/] {name}: {escape(estimate.method)}")
    elif estimate.reason:
        said = escape(estimate.doubt)
        if estimate.identified:
            name += f" {' and '.join(estimate.doubtful_axes)}"
            said += ", and as a whole it is not identified"
        out.prose(f"[yellow]prior-dominated[/] {name}: {said}")


def estimate_rows(estimate: Estimate) -> list[list[str]]:
    """Return the cells of `COLUMNS`, a row for each component."""
    name, unit = escape(str(estimate.parameter)), estimate.unit.removesuffix("1")
    rows: list[list[str]] = []
    for figure in figures(estimate):
        value = f"[bold]{figure.value}[/] ± {figure.std} {unit}".rstrip()
        interval = figure.limit or f"{figure.low} … {figure.high}"
        rows.append([f"{name} {figure.axis}".rstrip(), value, interval, _verdict(figure.verdict)])
    return rows or [[name, "–", "", _verdict(estimate.verdict)]]


def _verdict(verdict: str) -> str:
    return f"[{STYLES.get(verdict, 'bold red')}]{verdict}[/]"


def _truth_cells(estimate: Estimate, truth: Sequence[float]) -> list[str]:
    """Truth of an estimate, a cell for each of its rows."""
    count = max(len(estimate.values), 1)
    if len(truth) == count:
        return [f"{value:.5g}" for value in truth]
    together = " ".join(f"{value:.5g}" for value in truth)
    return [together or "–", *[""] * (count - 1)]
