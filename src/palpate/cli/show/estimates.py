"""Estimates on a terminal: one line a component, values and errors with the same digits."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from palpate.cli.console import escape, out
from palpate.cli.show.layout import Column, print_rows
from palpate.runs.figures import Figure, axes_of, figures

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
"""Of verdicts; red are those without one."""

UNSEEN = "no recording tells of it; what is said is what was believed before, with its width"


def show_estimates(
    estimates: Iterable[Estimate], truth: Mapping[Parameter, Sequence[float]] | None = None
) -> None:
    """The table, with a column of what is true where somebody knows, and below it what disagrees and
    why there is no value."""
    estimates = tuple(estimates)
    columns, rows = list(COLUMNS), [row for one in estimates for row in estimate_rows(one)]
    if truth:
        columns.append(Column("truth", style="dim"))
        trues = [cell for one in estimates for cell in _truths(one, truth.get(one.parameter, ()))]
        rows = [[*row, cell] for row, cell in zip(rows, trues, strict=True)]
    print_rows(columns, rows)
    for estimate in estimates:
        show_objection(estimate)


def show_objection(estimate: Estimate) -> None:
    """Print the contradiction of an estimate, or why there is none; nothing where all is well."""
    name = escape(str(estimate.parameter))
    if estimate.contradiction:
        said = escape(estimate.contradiction)
        out.prose(f"[bold red]contradicted[/] {name}: {said}")
    elif not estimate.has_value:
        said = escape(estimate.method)
        out.prose(f"[bold red]not identified[/] {name}: {said}")
    elif estimate.identified and estimate.unseen:
        axes = axes_of(len(estimate.values))
        parts = " and ".join(axes[place] for place in estimate.unseen)
        out.prose(f"[yellow]prior-dominated[/] {name} {parts}: {UNSEEN}")


def estimate_rows(estimate: Estimate) -> list[list[str]]:
    """Cells of `COLUMNS`, a row for each component."""
    name, unit = escape(str(estimate.parameter)), estimate.unit.removesuffix("1")
    rows = [_row(name, unit, figure) for figure in figures(estimate)]
    return rows or [[name, "–", "", _verdict(estimate.verdict)]]


def _row(name: str, unit: str, figure: Figure) -> list[str]:
    if figure.axis:
        name += f" {figure.axis}"
    value = f"[bold]{figure.value}[/] ± {figure.std} {unit}".rstrip()
    return [name, value, f"{figure.low} … {figure.high}", _verdict(figure.verdict)]


def _verdict(verdict: str) -> str:
    return f"[{STYLES.get(verdict, 'bold red')}]{verdict}[/]"


def _truths(estimate: Estimate, truth: Sequence[float]) -> list[str]:
    """A cell for each row of an estimate."""
    count = max(len(estimate.values), 1)
    if len(truth) == count:
        return [f"{value:.5g}" for value in truth]
    together = " ".join(f"{value:.5g}" for value in truth)
    return [together or "–", *[""] * (count - 1)]
