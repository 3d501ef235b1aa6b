"""`palpate study`: accuracy and efficiency of estimates, ablation and repeatability of planners."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.cli.command import command
from palpate.cli.console import Ticker, print_dim
from palpate.cli.options import MODEL, AsJson, Fields, settings
from palpate.runs.settings import settings_of

if TYPE_CHECKING:
    from palpate.studies.accuracy import Question
    from palpate.studies.summary import Runs
    from palpate.studies.trials import TrialRecord


Names = Annotated[list[str] | None, typer.Argument(metavar="[SCENARIO]...")]
Tasks = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[SCENARIO]...", help="all | kinds (one of each kind) | names [bottle_and_table]"
    ),
]
Trials = Annotated[int, typer.Option("--trials", min=1)]
ROUNDS = f"{MODEL}.rounds"
# Options of all trials in a study of planners. The paper has no rounds of feedback.
OfTrials = Annotated[
    Fields,
    settings(
        *("images", "noise", f"{MODEL}.base_url", ROUNDS),
        *(f"{MODEL}.budget.dollars", f"{MODEL}.critic"),
        defaults={ROUNDS: 0},
    ),
]


@dataclass(frozen=True)
class SeedOptions:
    """Seeds of a study, its workers, and the folder of its rows."""

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
        """Run all questions over all seeds."""
        from palpate.studies.summary import measure
        from palpate.studies.workers import crew

        seeds = range(self.first_seed, self.first_seed + self.seeds)
        ticker = Ticker()
        try:
            with crew(self.cluster, self.workers) as workers:
                return measure(questions, seeds, workers, self.out, ticker)
        finally:
            ticker.end()

    def page(self) -> None:
        """Write the page of all rows in the folder, if there is a folder."""
        from palpate.studies.accuracy_page import write_page

        if self.out is not None and (page := write_page(self.out)):
            print_dim(f"page: {page}")


@dataclass(frozen=True)
class TrialOptions:
    """Planners of a study, their trials in parallel, and the file of its results."""

    out: Annotated[
        Path, typer.Option("--out", help="File the results are appended to; run again to go on.")
    ]
    planner: Annotated[
        list[str],
        typer.Option("--planner", help="Planner to study, e.g. openai:MODEL; may be repeated."),
    ]
    workers: Annotated[
        int, typer.Option("--workers", help="Requests in flight.", min=1, max=64)
    ] = 4
    prompt: Annotated[
        list[str] | None,
        typer.Option(
            "--prompt", metavar="full|lean", help="System prompt, by default full; may be repeated."
        ),
    ] = None

    def show(
        self,
        study: Callable[..., Sequence[TrialRecord]],
        published: Mapping[str, str],
        names: list[str] | None,
        trials: int,
        given: Fields,
        as_json: bool,
    ) -> None:
        """Carry out a study of planners, write its page, and print its table next to the published one."""
        from palpate.cli.show_studies import show_trials
        from palpate.studies.attempt import Conditions
        from palpate.studies.planners_page import write_page

        asked = settings_of(**given)
        conditions = Conditions(asked.images, asked.noise, asked.model_settings.check_values())
        prompts = self.prompt or ["full"]
        try:
            summary = study(
                names or ["bottle_and_table"],
                self.planner,
                self.out,
                conditions,
                trials,
                in_flight=self.workers,
                say=print_dim,
                prompts=prompts,
            )
        finally:
            # Also after an error: the page shows the finished trials.
            if page := write_page(self.out):
                print_dim(f"page: {page}")
        show_trials(summary, published, as_json)


def accuracy(
    names: Names = None,
    *,
    given: Annotated[Fields, settings("noise", "request", "within", "robot_config")],
    over: SeedOptions,
    every: Annotated[
        bool, typer.Option("--all", help="Every scenario that the planner completes.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Repeat scenarios over many seeds and compare with the hidden truth.

    Each draws another arm, and objects that stand off by the accuracy of their poses (0.5 mm).

    With --out every run is kept as soon as it is done, and is not repeated.
    """
    from palpate.cli.show_studies import show_seed_runs
    from palpate.studies.accuracy import Question
    from palpate.studies.efficiency import comparable

    # Resolve paths here: a worker has another working directory.
    chosen = comparable() if every else names or ["bottle_and_table"]
    asked = settings_of(**given)
    changes = given | {"within": asked.within}
    if asked.robot_config is not None:
        changes["robot_config"] = asked.robot_config.absolute()
    try:
        runs = over.runs([Question(name, tuple(changes.items())) for name in chosen])
    finally:
        over.page()
    by_scenario = {group.scenario: seeds for group, seeds in runs.items()}
    show_seed_runs(by_scenario, f"--noise {asked.noise}", as_json)


def efficiency(
    names: Names = None,
    *,
    given: Annotated[Fields, settings("noise", "seed")],
    plot: Annotated[Path | None, typer.Option("--plot", help="HTML file for the plot.")] = None,
    as_json: AsJson = False,
) -> None:
    """Actions and robot time of the symbolic planner against the exhaustive one."""
    from palpate.cli.show_studies import show_comparisons
    from palpate.studies import efficiency

    rows = efficiency.efficiency(names or efficiency.comparable(), given["noise"], given["seed"])
    if plot:
        plot.write_text(efficiency.plot(rows), encoding="utf-8")
    show_comparisons(rows, efficiency.PAPER, as_json)


def ablation(
    names: Tasks = None,
    *,
    over: TrialOptions,
    trials: Trials = 10,
    configuration: Annotated[
        list[str] | None, typer.Option("--configuration", help="Default: all.")
    ] = None,
    shared: OfTrials,
    as_json: AsJson = False,
) -> None:
    """The paper's table II: ablation of the parts of the prompt.

    A page next to the results compares them with the paper's tables.
    """
    from palpate.studies import ablation as studies

    study = partial(studies.ablation, configurations=configuration or studies.CONFIGURATIONS)
    over.show(study, studies.published_ablation(), names, trials, shared, as_json)


def repeatability(
    names: Tasks = None,
    *,
    over: TrialOptions,
    trials: Trials = 20,
    shared: OfTrials,
    as_json: AsJson = False,
) -> None:
    """The paper's table III: repeated trials of the same task.

    A page next to the results compares them with the paper's tables.
    """
    from palpate.studies import ablation as studies

    published = studies.published_repeatability()
    over.show(studies.repeatability, published, names, trials, shared, as_json)


app = typer.Typer(
    no_args_is_help=True, help="Run a study: accuracy, efficiency, ablation, repeatability."
)
for study in (accuracy, efficiency, ablation, repeatability):
    command(app)(study)
