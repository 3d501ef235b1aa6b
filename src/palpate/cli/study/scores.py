"""Studies over scenarios and seeds: how true the numbers are, and how long they take."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.options.motion import NoiseLevel
from palpate.cli.options.results import AsJson
from palpate.cli.study.options import AskedOptions, Names, Seed, SeedOptions


def accuracy(
    names: Names = None,
    *,
    asked: AskedOptions,
    over: SeedOptions,
    every: Annotated[
        bool, typer.Option("--all", help="Every scenario that the planner completes.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Repeat scenarios over many seeds, against the hidden truth.

    Each draws another arm, and objects that stand off by the accuracy of their poses (0.5 mm).

    With --out every run is kept as soon as it is done, and what is there is not run again.
    """
    from palpate.cli.show.studies.scores import show_seed_runs
    from palpate.studies.accuracy import Question
    from palpate.studies.efficiency import comparable

    chosen = comparable() if every else names or ["bottle_and_table"]
    changes = tuple(asked.changes().items())
    try:
        runs = over.runs([Question(name, changes) for name in chosen])
    finally:
        over.page()
    found = {group.scenario: seeds for group, seeds in runs.items()}
    show_seed_runs(found, f"--noise {asked.noise}", as_json)


def efficiency(
    names: Names = None,
    *,
    noise: NoiseLevel = "lab",
    seed: Seed = 0,
    plot: Annotated[Path | None, typer.Option("--plot", help="HTML file for the plot.")] = None,
    as_json: AsJson = False,
) -> None:
    """Actions and robot time of the symbolic planner against the exhaustive one."""
    from palpate.cli.show.studies.scores import show_comparisons
    from palpate.studies import efficiency

    found = efficiency.efficiency(names or efficiency.comparable(), noise, seed)
    if plot:
        plot.write_text(efficiency.plot(found), encoding="utf-8")
    show_comparisons(found, efficiency.PAPER, as_json)
