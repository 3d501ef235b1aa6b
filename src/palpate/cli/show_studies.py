"""Output of the studies: estimates over many seeds, effort of two planners, trials of planners."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from statistics import fmean
from typing import Any

from rich.markup import escape
from rich.table import Table
from rich.text import Text

from palpate.cli.console import figure_table, out, print_json
from palpate.cli.show_layout import Cell, TableColumn, print_rows
from palpate.runs.report.console import SafeConsole
from palpate.studies.accuracy import SeedRun
from palpate.studies.efficiency import PlannerComparison, PublishedEffort, Rate
from palpate.studies.summary import Summary, summarise
from palpate.studies.trials import ConfigurationRow, TrialRecord, by_scenario, table

SUMMARY = ("parameter", "truth", "bias", "SD", "stated", "1-shot", "in 95 %", "known")
SUMMARY_WIDTH = 80  # Characters of the narrowest table
EFFORT = (
    TableColumn("scenario"),
    TableColumn("exhaustive", right=True),
    TableColumn("robot s", right=True),
    TableColumn("intent-driven", right=True),
    TableColumn("robot s", right=True),
    TableColumn("time saved", right=True),
)


def show_seed_runs(runs: Mapping[str, Sequence[SeedRun]], title: str, as_json: bool) -> None:
    """Print estimates against the truth, scenario by scenario."""
    if as_json:
        scenarios = [
            {
                "scenario": name,
                "statuses": _statuses(trials),
                "actions": trials[0].actions,
                "robot_seconds": _robot_seconds(trials),
                "rows": [asdict(row) for row in summarise(trials)],
            }
            for name, trials in runs.items()
        ]
        print_json({"title": title, "scenarios": scenarios})
        return
    shown = SafeConsole(highlight=False, width=max(out.width, SUMMARY_WIDTH))
    shown.print(Text(title, "italic"))
    for name, trials in runs.items():
        shown.print(Text(name, "bold"))
        ended = ", ".join(f"{count} {status}" for status, count in _statuses(trials).items())
        shown.print(
            _summary_table(trials),
            Text(f"{ended}; {trials[0].actions} actions, {_robot_seconds(trials):.1f} s", "dim"),
            sep="\n",
        )


def _summary_table(runs: Sequence[SeedRun]) -> Table:
    """Make the table of the summaries. In a narrow terminal names are broken, never figures."""
    rows = [_summary_cells(row) for row in summarise(runs)]
    table = figure_table(*SUMMARY)
    table.padding = (0, 1, 0, 0)
    # Only the names may be broken; the other columns keep the width of their longest figure.
    names, *figures = table.columns
    names.overflow = "fold"
    for place, column in enumerate(figures, start=1):
        column.min_width = max(len(row[place]) for row in [SUMMARY, *rows])
    for row in rows:
        table.add_row(*row)
    return table


def _summary_cells(row: Summary) -> list[str]:
    name = str(row.parameter)
    if row.component:
        name += f"[{row.component}]"
    return [
        escape(name),
        f"{row.truth:.4g}",
        _figure(row.bias, "+.2g"),
        _figure(row.sd, ".2g"),
        _figure(row.claimed, ".2g"),
        _figure(row.single_shot_sd, ".2g"),
        f"{row.covered}/{row.runs}",
        f"{row.runs}/{row.asked}",
    ]


def _figure(value: float | None, form: str) -> str:
    return "–" if value is None else format(value, form)


def _statuses(runs: Sequence[SeedRun]) -> dict[str, int]:
    return dict(Counter(run.status for run in runs))


def _robot_seconds(runs: Sequence[SeedRun]) -> float:
    return fmean(run.robot_seconds for run in runs)


def show_comparisons(
    rows: Sequence[PlannerComparison], paper: PublishedEffort, as_json: bool
) -> None:
    """Print the effort of both planners, and the time that intent saves."""
    if as_json:
        print_json(
            {
                "scenarios": [
                    {
                        "scenario": row.scenario,
                        "exhaustive": _seed_run_json(row.exhaustive),
                        "intent": _seed_run_json(row.intent),
                        "time_saved": row.time_saved,
                    }
                    for row in rows
                ]
            }
        )
        return
    cells: list[list[str]] = []
    for row in rows:
        saved = "not completed" if row.time_saved is None else f"{row.time_saved:.0%}"
        effort = (*_effort_cells(row.exhaustive), *_effort_cells(row.intent))
        cells.append([escape(row.scenario), *effort, saved])
    pair = (
        str(paper.exhaustive_actions),
        f"{paper.exhaustive_seconds:.0f}",
        str(paper.intent_actions),
        f"{paper.intent_seconds:.0f}",
    )
    cells.append(["[dim]the paper's pair[/]", *pair, f"{paper.time_saved:.0%}"])
    print_rows(EFFORT, cells, "Actions and robot time of both planners")


def _effort_cells(run: SeedRun) -> tuple[str, str]:
    return str(run.actions), f"{run.robot_seconds:.1f}"


def _seed_run_json(run: SeedRun) -> dict[str, Any]:
    """A run with its estimates under the name in the JSON contract."""
    fields = asdict(run)
    fields["trials"] = fields.pop("estimates")
    return fields


TRIALS = (
    TableColumn("configuration", words=True),
    TableColumn("planner", words=True),
    TableColumn("syntax"),
    TableColumn("valid"),
    TableColumn("success"),
    TableColumn("tokens", right=True),
    TableColumn("US $", right=True),
)
PAPER = TableColumn("paper: syntax, success")


def show_trials(
    records: Sequence[TrialRecord], published: Mapping[str, str], as_json: bool
) -> None:
    """Print rates with their 95 % Wilson intervals, next to the published syntax and success.

    With several scenarios, the rates of each are printed below.
    """
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
        _show_rows(single, TableColumn("scenario", words=True), [row.scenario for row in single])


def _show_rows(rows: Sequence[ConfigurationRow], last: TableColumn, cells: Sequence[str]) -> None:
    """Print rows of trials with an additional last column."""
    shown: list[list[Cell]] = []
    for row, cell in zip(rows, cells, strict=True):
        shown.append([*_row_cells(row), Text(cell)])
    print_rows([*TRIALS, last], shown)


def _row_cells(row: ConfigurationRow) -> list[Cell]:
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


def _row_json(row: ConfigurationRow) -> dict[str, Any]:
    # A rate of success exists only for judged trials.
    rates: dict[str, Rate] = {"syntax": row.syntax, "valid": row.valid}
    if row.success:
        rates["success"] = row.success
    intervals = {name: rate.interval for name, rate in rates.items()}
    return asdict(row) | {"intervals": intervals}
