"""`palpate study …`: the studies, as tables on the terminal and as JSON files."""

from __future__ import annotations

import os
from collections import Counter
from dataclasses import asdict
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from palpate.studies.accuracy import SeedRun, Summary
    from palpate.studies.attempt import Conditions
    from palpate.studies.efficiency import Comparison, PublishedEffort
    from palpate.studies.trials import Rate, Record, Row

app = typer.Typer(
    no_args_is_help=True,
    help="Run a study: accuracy, variety, efficiency, ablation, repeatability, faults.",
)

CORES = os.cpu_count() or 1
TABLE_WIDTH = 130
"""Characters of the models' tables, whatever the terminal has: rates with intervals are not
broken."""
Noise = Annotated[str, typer.Option("--noise", help="Sensor world: none, lab or datasheet.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]
Workers = Annotated[int, typer.Option("--workers", help="Processes.", min=1)]
Planners = Annotated[
    list[str],
    typer.Option("--planner", help="Planner to study, e.g. openai:MODEL; may be repeated."),
]
InFlight = Annotated[int, typer.Option("--workers", help="Requests in flight.", min=1, max=64)]
Results = Annotated[
    Path, typer.Option("--out", help="File the results are appended to; run again to go on.")
]
Images = Annotated[
    list[Path] | None, typer.Option("--image", help="Picture (default: rendered from the world).")
]
BaseUrl = Annotated[str | None, typer.Option("--base-url", help="Address of the model's server.")]
Feedback = Annotated[
    int, typer.Option("--feedback", min=0, max=10, help="Rounds of feedback; the paper has none.")
]
Dollars = Annotated[
    float,
    typer.Option("--budget-dollars", min=0, help="Most that one plan may cost, by list prices."),
]


@app.command()
def accuracy(
    names: Annotated[list[str] | None, typer.Argument(metavar="[SCENARIO]...")] = None,
    noise: Noise = "lab",
    seeds: Annotated[int, typer.Option("--seeds", min=1)] = 20,
    workers: Workers = CORES,
    every: Annotated[
        bool, typer.Option("--all", help="Every scenario that the planner completes.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Repeat scenarios over many seeds, against the hidden truth."""
    from palpate.scenarios.catalogue import scenario as find
    from palpate.studies.accuracy import accuracy as run_accuracy
    from palpate.studies.efficiency import comparable

    chosen = comparable() if every else names or ["bottle_and_table"]
    settings = {name: find(name).settings(noise=noise).checked() for name in chosen}
    runs = {name: run_accuracy(each, range(seeds), workers) for name, each in settings.items()}
    _show_runs(runs, f"--noise {noise}", as_json)


@app.command()
def variety(
    noise: Noise = "lab",
    seed: Annotated[int, typer.Option("--seed", min=0)] = 0,
    workers: Workers = CORES,
    as_json: AsJson = False,
) -> None:
    """Ten scenes of other objects, heights and gaps, one run each."""
    from palpate.studies.variety import run_all

    _show_runs(
        {name: [run] for name, run in run_all(noise, seed, workers).items()},
        f"--noise {noise}",
        as_json,
    )


@app.command()
def efficiency(
    names: Annotated[list[str] | None, typer.Argument(metavar="[SCENARIO]...")] = None,
    noise: Noise = "lab",
    seed: Annotated[int, typer.Option("--seed", min=0)] = 0,
    plot: Annotated[Path | None, typer.Option("--plot", help="HTML file for the plot.")] = None,
    as_json: AsJson = False,
) -> None:
    """Actions and robot time of the symbolic planner against the exhaustive one."""
    from palpate.studies.efficiency import PAPER, comparable
    from palpate.studies.efficiency import efficiency as run_efficiency

    found = run_efficiency(names or comparable(), noise, seed)
    if plot:
        _plot_comparisons(plot, found, PAPER)
    if as_json:
        from palpate.cli.show import print_json

        print_json({"scenarios": [asdict(c) | {"time_saved": c.time_saved} for c in found]})
        return
    _show_comparisons(found, PAPER)


@app.command()
def ablation(
    out: Results,
    planner: Planners,
    scenario: Annotated[str, typer.Argument()] = "bottle_and_table",
    trials: Annotated[int, typer.Option("--trials", min=1)] = 10,
    workers: InFlight = 4,
    configuration: Annotated[
        list[str] | None, typer.Option("--configuration", help="Default: all.")
    ] = None,
    image: Images = None,
    noise: Noise = "lab",
    base_url: BaseUrl = None,
    feedback: Feedback = 0,
    budget_dollars: Dollars = 2,
    as_json: AsJson = False,
) -> None:
    """The paper's table II: what each part of the prompt is worth."""
    from palpate.studies.ablation import CONFIGURATIONS, PAPER
    from palpate.studies.ablation import ablation as run_ablation

    conditions = _conditions(image, noise, base_url, feedback, budget_dollars)
    records = run_ablation(
        scenario, planner, out, conditions, trials, configuration or CONFIGURATIONS, workers, _say
    )
    _show_trials(
        records,
        {name: f"{a}/10, {'–' if b is None else f'{b}/10'}" for name, (a, b) in PAPER.items()},
        as_json,
    )


@app.command()
def repeatability(
    out: Results,
    planner: Planners,
    scenario: Annotated[str, typer.Argument()] = "bottle_and_table",
    trials: Annotated[int, typer.Option("--trials", min=1)] = 20,
    workers: InFlight = 4,
    image: Images = None,
    noise: Noise = "lab",
    base_url: BaseUrl = None,
    feedback: Feedback = 0,
    budget_dollars: Dollars = 2,
    as_json: AsJson = False,
) -> None:
    """The paper's table III: the same task over and over."""
    from palpate.studies.repeatability import PAPER
    from palpate.studies.repeatability import repeatability as run_repeatability

    conditions = _conditions(image, noise, base_url, feedback, budget_dollars)
    records = run_repeatability(scenario, planner, out, conditions, trials, workers, _say)
    found = {f"{a}/20, {b}/20" for a, b in PAPER.values()}
    _show_trials(records, {"full": "; ".join(sorted(found))}, as_json)


@app.command()
def faults(
    names: Annotated[list[str] | None, typer.Argument(metavar="[SCENARIO]...")] = None,
    noise: Noise = "lab",
    seeds: Annotated[int, typer.Option("--seeds", min=1)] = 5,
    workers: Workers = CORES,
    as_json: AsJson = False,
) -> None:
    """What goes wrong on purpose: how each mishap ends, and whether anything is dropped."""
    from palpate.cli.show import out, print_json
    from palpate.studies.faults import faults as run_faults
    from palpate.studies.faults import mishaps, table

    endings = run_faults(names or mishaps(), noise, range(seeds), workers)
    if as_json:
        print_json({"runs": [asdict(e) for e in endings]})
        return
    grid = _grid("mishap", "ended", "as it should", "dropped", "still held")
    for r in table(endings):
        ended = ", ".join(f"{status} {count}" for status, count in r.endings.items())
        grid.add_row(r.scenario, ended, f"{r.as_expected}/{r.runs}", str(r.dropped), str(r.holding))
    out.print(
        grid, *(Text(f"{r.scenario}: {r.reason[:200]}", "dim") for r in table(endings)), sep="\n"
    )


def _conditions(
    images: list[Path] | None, noise: str, base_url: str | None, rounds: int, dollars: float
) -> Conditions:
    from palpate.planning.model.session import Budget, ModelSettings
    from palpate.studies.attempt import Conditions

    model_settings = ModelSettings(base_url=base_url, rounds=rounds, budget=Budget(dollars=dollars))
    return Conditions(tuple(images or ()), noise, model_settings)


def _say(line: str) -> None:
    from palpate.cli.show import err

    err.print(Text(line, "dim"), soft_wrap=True)


def _show_trials(records: list[Record], paper: dict[str, str], as_json: bool) -> None:
    """Rates with their 95 % Wilson intervals, beside the paper's syntax and success."""
    from palpate.cli.show import out, print_json
    from palpate.studies.trials import table

    rows = table(records)
    if as_json:
        print_json(
            {
                "rows": [
                    asdict(r) | {"intervals": {k: rate.interval for k, rate in _rates(r).items()}}
                    for r in rows
                ]
            }
        )
        return
    grid = _grid(
        "configuration",
        "planner",
        "syntax",
        "valid",
        "success",
        "tokens",
        "US $",
        "paper: syntax, success",
    )
    for r in rows:
        cost = "–" if r.cost is None else f"{r.cost:.3f}"
        grid.add_row(
            r.configuration,
            Text(r.planner),
            str(r.syntax),
            str(r.valid),
            str(r.success or "–"),
            f"{r.tokens:.0f}",
            cost,
            paper.get(r.configuration, "–"),
        )
    Console(highlight=False, width=max(out.width, TABLE_WIDTH)).print(grid)


def _rates(row: Row) -> dict[str, Rate]:
    rates = {"syntax": row.syntax, "valid": row.valid}
    return rates | {"success": row.success} if row.success else rates


def _grid(*headings: str) -> Table:
    grid = Table(box=None, header_style="dim", pad_edge=False)
    for heading in headings:
        grid.add_column(heading)
    return grid


def _show_runs(runs: dict[str, list[SeedRun]], title: str, as_json: bool) -> None:
    from palpate.cli.show import print_json
    from palpate.studies.accuracy import summarise

    if as_json:
        print_json(
            {"title": title, "scenarios": [_runs_json(name, found) for name, found in runs.items()]}
        )
        return
    table = Table(title=title, title_justify="left", box=None, header_style="dim", pad_edge=False)
    for heading in ("parameter", "truth", "mean", "bias", "SD", "stated", "in 95 %", "1-shot SD"):
        table.add_column(
            heading, justify="left" if heading == "parameter" else "right", no_wrap=True
        )
    for name, found in runs.items():
        table.add_row(f"[bold]{name}[/]")
        for row in summarise(found):
            table.add_row(*_summary_cells(row))
        table.add_row(f"[dim]{_endings(found)}[/]")
    Console(highlight=False, width=TABLE_WIDTH).print(table)


def _summary_cells(row: Summary) -> list[str]:
    name = f"  {row.parameter}" + (f"[{row.component}]" if row.component else "")
    shot = f"{row.single_shot_sd:.3g}" if row.single_shot_sd is not None else "–"
    return [
        escape(name),
        f"{row.truth:.4g}",
        f"{row.mean:.4g}",
        f"{row.bias:+.2g}",
        f"{row.sd:.2g}",
        f"{row.claimed:.2g}",
        f"{row.covered}/{row.runs}",
        shot,
    ]


def _endings(runs: list[SeedRun]) -> str:
    """How the runs ended, and what they took."""
    counts = Counter(run.status for run in runs)
    ended = ", ".join(f"{n} {status}" for status, n in counts.items())
    return f"  {ended}; {runs[0].actions} actions, {fmean(r.robot_seconds for r in runs):.1f} s"


def _runs_json(name: str, runs: list[SeedRun]) -> dict[str, Any]:
    from palpate.studies.accuracy import summarise

    return {
        "scenario": name,
        "statuses": dict(Counter(run.status for run in runs)),
        "actions": runs[0].actions,
        "robot_seconds": fmean(r.robot_seconds for r in runs),
        "rows": [asdict(r) for r in summarise(runs)],
    }


def _plot_comparisons(file: Path, rows: list[Comparison], paper: PublishedEffort) -> None:
    from palpate.report.efficiency import Effort, efficiency_page

    efforts = [
        Effort(
            c.scenario,
            (c.exhaustive.actions, c.intent.actions),
            (c.exhaustive.robot_seconds, c.intent.robot_seconds),
        )
        for c in rows
    ]
    page = efficiency_page(
        efforts,
        Effort(
            "the paper's pair",
            (paper.exhaustive_actions, paper.intent_actions),
            (paper.exhaustive_seconds, paper.intent_seconds),
        ),
    )
    file.write_text(page, encoding="utf-8")


def _show_comparisons(rows: list[Comparison], paper: PublishedEffort) -> None:
    from palpate.cli.show import out

    table = Table(box=None, header_style="dim", pad_edge=False)
    for heading in (
        "scenario",
        "exhaustive actions",
        "robot s",
        "intent-driven actions",
        "robot s",
        "time saved",
    ):
        table.add_column(heading, justify="left" if heading == "scenario" else "right")
    for c in rows:
        table.add_row(
            c.scenario,
            str(c.exhaustive.actions),
            f"{c.exhaustive.robot_seconds:.1f}",
            str(c.intent.actions),
            f"{c.intent.robot_seconds:.1f}",
            f"{c.time_saved:.0%}" if c.time_saved is not None else "not completed",
        )
    table.add_row(
        "[dim]the paper's pair[/]",
        str(paper.exhaustive_actions),
        f"{paper.exhaustive_seconds:.0f}",
        str(paper.intent_actions),
        f"{paper.intent_seconds:.0f}",
        f"{paper.time_saved:.0%}",
    )
    out.print(table)
