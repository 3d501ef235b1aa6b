"""Options that several studies share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.cli.console import Ticker, aside
from palpate.cli.options import MODEL, Given, settings
from palpate.settings import settings_of

if TYPE_CHECKING:
    from palpate.studies.accuracy import Question
    from palpate.studies.planners.attempt import Conditions
    from palpate.studies.scores.kept import Runs


Names = Annotated[list[str] | None, typer.Argument(metavar="[SCENARIO]...")]
Tasks = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[SCENARIO]...", help="all | kinds (one of each kind) | names [bottle_and_table]"
    ),
]
FIRST = ["bottle_and_table"]
Planners = Annotated[
    list[str],
    typer.Option("--planner", help="Planner to study, e.g. openai:MODEL; may be repeated."),
]
Trials = Annotated[int, typer.Option("--trials", min=1)]
InFlight = Annotated[int, typer.Option("--workers", help="Requests in flight.", min=1, max=64)]
Results = Annotated[
    Path, typer.Option("--out", help="File the results are appended to; run again to go on.")
]
Prompts = Annotated[
    list[str] | None,
    typer.Option("--prompt", metavar="full|lean", help="Which prompt [full]; may be repeated."),
]
ROUNDS = f"{MODEL}.rounds"
OfTrials = Annotated[
    Given,
    settings(
        *("images", "noise", f"{MODEL}.base_url", ROUNDS),
        *(f"{MODEL}.budget.dollars", f"{MODEL}.critic"),
        defaults={ROUNDS: 0},
    ),
]
"""Options of all trials in a study of planners; the paper has no rounds of feedback."""


@dataclass(frozen=True)
class SeedOptions:
    """Over which seeds, by whom, and where they are kept."""

    seeds: Annotated[int, typer.Option("--seeds", min=1)] = 20
    first_seed: Annotated[int, typer.Option("--first-seed", help="The first one.", min=0)] = 0
    workers: Annotated[
        int | None,
        typer.Option("--workers", min=1, help="At once (default: one for each processor)."),
    ] = None
    cluster: Annotated[
        str,
        typer.Option(
            "--cluster",
            metavar="ADDRESS",
            help="Ray cluster: auto | HOST:PORT | ray://HOST:PORT | local, which is none.",
        ),
    ] = "local"
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", help="Folder of the rows and of a page with plots; run again to go on."
        ),
    ] = None

    def runs(self, questions: Sequence[Question]) -> Runs:
        """The runs of all questions."""
        from palpate.studies.cluster import crew
        from palpate.studies.scores.kept import measure

        seeds = range(self.first_seed, self.first_seed + self.seeds)
        ticker = Ticker()
        try:
            with crew(self.cluster, self.workers) as workers:
                return measure(questions, seeds, workers, self.out, ticker)
        finally:
            ticker.end()

    def page(self) -> None:
        """Write the page of all that the folder holds, where there is one."""
        from palpate.studies.scores.page import write_page

        if self.out is not None and (page := write_page(self.out)):
            aside(f"page: {page}")


def conditions(given: Given) -> Conditions:
    """Conditions for the studies of planners."""
    from palpate.studies.planners.attempt import Conditions

    asked = settings_of(**given)
    return Conditions(asked.images, asked.noise, asked.model_settings.checked())
