"""`palpate study …`: the studies, as tables on the terminal and as JSON files."""

from __future__ import annotations

import os
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from palpate.studies.accuracy import Summary
    from palpate.studies.attempt import Settings
    from palpate.studies.efficiency import Comparison
    from palpate.studies.trials import Rate, Record, Row

app = typer.Typer(no_args_is_help=True,
                  help="Run a study: accuracy, variety, efficiency, ablation, repeatability, faults.")

CORES = os.cpu_count() or 1
TABLE_WIDTH = 130
"""Characters of the models' tables, whatever the terminal has: rates with intervals are not broken."""
Noise = Annotated[str, typer.Option("--noise", help="Sensor world: none, lab or datasheet.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]
Workers = Annotated[int, typer.Option("--workers", help="Processes.", min=1)]
Planners = Annotated[list[str], typer.Option("--planner", help="Planner to study, e.g. openai:MODEL; may be repeated.")]
InFlight = Annotated[int, typer.Option("--workers", help="Requests in flight.", min=1, max=64)]
Results = Annotated[Path, typer.Option("--out", help="File the results are appended to; run again to go on.")]
Images = Annotated[list[Path] | None, typer.Option("--image", help="Picture (default: rendered from the world).")]
BaseUrl = Annotated[str | None, typer.Option("--base-url", help="Address of the model's server.")]
Feedback = Annotated[int, typer.Option("--feedback", min=0, max=10, help="Rounds of feedback; the paper has none.")]
Dollars = Annotated[float, typer.Option("--budget-dollars", min=0, help="Most that one plan may cost, by list prices.")]


@app.command()
def accuracy(scenario: Annotated[str, typer.Argument()] = "bottle_and_table", noise: Noise = "lab",
             seeds: Annotated[int, typer.Option("--seeds", min=1)] = 20, workers: Workers = CORES,
             as_json: AsJson = False) -> None:
    """Repeat a scenario over many seeds, against the hidden truth."""
    from palpate.scenarios.catalogue import scenario as find
    from palpate.studies.accuracy import accuracy as run_accuracy
    from palpate.studies.accuracy import summarise

    runs = run_accuracy(find(scenario).job(noise=noise).checked(), range(seeds), workers)
    _show_summaries(summarise(runs), f"{scenario}, --noise {noise}, {seeds} seeds", as_json)


@app.command()
def variety(noise: Noise = "lab", seed: Annotated[int, typer.Option("--seed", min=0)] = 0,
            workers: Workers = CORES, as_json: AsJson = False) -> None:
    """Ten scenes of other objects, heights and gaps, one run each."""
    from palpate.studies.accuracy import summarise
    from palpate.studies.variety import run_all

    runs = run_all(noise, seed, workers)
    for name, run in runs.items():
        _show_summaries(summarise([run]), f"{name}: {run.status}, {run.actions} actions, {run.robot_seconds:.1f} s",
                        as_json)


@app.command()
def efficiency(names: Annotated[list[str] | None, typer.Argument(metavar="[SCENARIO]...")] = None, noise: Noise = "lab",
               seed: Annotated[int, typer.Option("--seed", min=0)] = 0,
               plot: Annotated[Path | None, typer.Option("--plot", help="HTML file for the plot.")] = None,
               as_json: AsJson = False) -> None:
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
def ablation(out: Results, planner: Planners, scenario: Annotated[str, typer.Argument()] = "bottle_and_table",
             trials: Annotated[int, typer.Option("--trials", min=1)] = 10, workers: InFlight = 4,
             configuration: Annotated[list[str] | None, typer.Option("--configuration", help="Default: all.")] = None,
             image: Images = None, noise: Noise = "lab", base_url: BaseUrl = None, feedback: Feedback = 0,
             budget_dollars: Dollars = 2, as_json: AsJson = False) -> None:
    """The paper's table II: what each part of the prompt is worth."""
    from palpate.studies.ablation import CONFIGURATIONS, PAPER
    from palpate.studies.ablation import ablation as run_ablation

    settings = _settings(image, noise, base_url, feedback, budget_dollars)
    records = run_ablation(scenario, planner, out, settings, trials, configuration or CONFIGURATIONS, workers, _say)
    _show_trials(records, {name: f"{a}/10, {'–' if b is None else f'{b}/10'}" for name, (a, b) in PAPER.items()},
                 as_json)


@app.command()
def repeatability(out: Results, planner: Planners, scenario: Annotated[str, typer.Argument()] = "bottle_and_table",
                  trials: Annotated[int, typer.Option("--trials", min=1)] = 20, workers: InFlight = 4,
                  image: Images = None, noise: Noise = "lab", base_url: BaseUrl = None, feedback: Feedback = 0,
                  budget_dollars: Dollars = 2, as_json: AsJson = False) -> None:
    """The paper's table III: the same task over and over."""
    from palpate.studies.repeatability import PAPER
    from palpate.studies.repeatability import repeatability as run_repeatability

    settings = _settings(image, noise, base_url, feedback, budget_dollars)
    records = run_repeatability(scenario, planner, out, settings, trials, workers, _say)
    found = {f"{a}/20, {b}/20" for a, b in PAPER.values()}
    _show_trials(records, {"full": "; ".join(sorted(found))}, as_json)


@app.command()
def faults(names: Annotated[list[str] | None, typer.Argument(metavar="[SCENARIO]...")] = None, noise: Noise = "lab",
           seeds: Annotated[int, typer.Option("--seeds", min=1)] = 5, workers: Workers = CORES,
           as_json: AsJson = False) -> None:
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
    out.print(grid, *(Text(f"{r.scenario}: {r.reason[:200]}", "dim") for r in table(endings)), sep="\n")


def _settings(images: list[Path] | None, noise: str, base_url: str | None, rounds: int, dollars: float) -> Settings:
    from palpate.planning.session import Asking, Budget
    from palpate.studies.attempt import Settings

    asking = Asking(base_url=base_url, rounds=rounds, budget=Budget(dollars=dollars))
    return Settings(tuple(images or ()), noise, asking)


def _say(line: str) -> None:
    from palpate.cli.show import err

    err.print(Text(line, "dim"), soft_wrap=True)


def _show_trials(records: list[Record], paper: dict[str, str], as_json: bool) -> None:
    """Rates with their 95 % Wilson intervals, beside the paper's syntax and success."""
    from palpate.cli.show import out, print_json
    from palpate.studies.trials import table

    rows = table(records)
    if as_json:
        print_json({"rows": [asdict(r) | {"intervals": {k: rate.interval for k, rate in _rates(r).items()}}
                             for r in rows]})
        return
    grid = _grid("configuration", "planner", "syntax", "valid", "success", "tokens", "US $", "paper: syntax, success")
    for r in rows:
        cost = "–" if r.cost is None else f"{r.cost:.3f}"
        grid.add_row(r.configuration, Text(r.planner), str(r.syntax), str(r.valid), str(r.success or "–"),
                     f"{r.tokens:.0f}", cost, paper.get(r.configuration, "–"))
    Console(highlight=False, width=max(out.width, TABLE_WIDTH)).print(grid)


def _rates(row: Row) -> dict[str, Rate]:
    rates = {"syntax": row.syntax, "valid": row.valid}
    return rates | {"success": row.success} if row.success else rates


def _grid(*headings: str) -> Table:
    grid = Table(box=None, header_style="dim", pad_edge=False)
    for heading in headings:
        grid.add_column(heading)
    return grid


def _show_summaries(rows: list[Summary], title: str, as_json: bool) -> None:
    from palpate.cli.show import out, print_json

    if as_json:
        print_json({"title": title, "rows": [asdict(r) for r in rows]})
        return
    table = Table(title=title, title_justify="left", box=None, header_style="dim", pad_edge=False)
    for heading in ("parameter", "truth", "mean", "bias", "SD", "claimed std", "95 % covers", "single-shot SD"):
        table.add_column(heading, justify="left" if heading == "parameter" else "right")
    for r in rows:
        name = str(r.gap) + (f"[{r.component}]" if r.component else "")
        shot = f"{r.single_shot_sd:.4g}" if r.single_shot_sd is not None else "–"
        table.add_row(name, f"{r.truth:.5g}", f"{r.mean:.5g}", f"{r.bias:+.3g}", f"{r.sd:.3g}", f"{r.claimed:.3g}",
                      f"{r.covered}/{r.runs}", shot)
    out.print(table)


def _plot_comparisons(file: Path, rows: list[Comparison], paper: tuple[int, float, int, float]) -> None:
    from palpate.report.efficiency import Effort, efficiency_page

    efforts = [Effort(c.scenario, (c.exhaustive.actions, c.intent.actions),
                      (c.exhaustive.robot_seconds, c.intent.robot_seconds)) for c in rows]
    page = efficiency_page(efforts, Effort("the paper's pair", (paper[0], paper[2]), (paper[1], paper[3])))
    file.write_text(page, encoding="utf-8")


def _show_comparisons(rows: list[Comparison], paper: tuple[int, float, int, float]) -> None:
    from palpate.cli.show import out

    table = Table(box=None, header_style="dim", pad_edge=False)
    for heading in ("scenario", "exhaustive actions", "robot s", "intent-driven actions", "robot s", "time saved"):
        table.add_column(heading, justify="left" if heading == "scenario" else "right")
    for c in rows:
        table.add_row(c.scenario, str(c.exhaustive.actions), f"{c.exhaustive.robot_seconds:.1f}", str(c.intent.actions),
                      f"{c.intent.robot_seconds:.1f}", f"{c.time_saved:.0%}")
    table.add_row("[dim]the paper's pair[/]", f"{paper[0]}", f"{paper[1]:.0f}", f"{paper[2]}", f"{paper[3]:.0f}", "47%")
    out.print(table)
