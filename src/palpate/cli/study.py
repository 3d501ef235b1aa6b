"""`palpate study …`: the studies, as tables on the terminal and as JSON files."""

from __future__ import annotations

import os
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

if TYPE_CHECKING:
    from palpate.studies.accuracy import Summary
    from palpate.studies.efficiency import Comparison

app = typer.Typer(no_args_is_help=True, help="Run a study: accuracy, efficiency, variety, ablation, repeatability.")

CORES = os.cpu_count() or 1
Noise = Annotated[str, typer.Option("--noise", help="Sensor world: none, lab or datasheet.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]
Workers = Annotated[int, typer.Option("--workers", help="Processes.", min=1)]


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
