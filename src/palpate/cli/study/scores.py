"""Studies over scenarios and seeds: how true the numbers are, and how long they take."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.options import AsJson, Given, settings
from palpate.cli.study.options import Names, SeedOptions
from palpate.settings import settings_of


def accuracy(
    names: Names = None,
    *,
    given: Annotated[Given, settings("noise", "request", "within", "robot_config")],
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
    asked = settings_of(**given)
    changes = given | {"within": asked.within}
    if asked.robot_config is not None:
        changes["robot_config"] = asked.robot_config.absolute()
    try:
        runs = over.runs([Question(name, tuple(changes.items())) for name in chosen])
    finally:
        over.page()
    found = {group.scenario: seeds for group, seeds in runs.items()}
    show_seed_runs(found, f"--noise {asked.noise}", as_json)


def efficiency(
    names: Names = None,
    *,
    given: Annotated[Given, settings("noise", "seed")],
    plot: Annotated[Path | None, typer.Option("--plot", help="HTML file for the plot.")] = None,
    as_json: AsJson = False,
) -> None:
    """Actions and robot time of the symbolic planner against the exhaustive one."""
    from palpate.cli.show.studies.scores import show_comparisons
    from palpate.studies import efficiency

    found = efficiency.efficiency(names or efficiency.comparable(), given["noise"], given["seed"])
    if plot:
        plot.write_text(efficiency.plot(found), encoding="utf-8")
    show_comparisons(found, efficiency.PAPER, as_json)
