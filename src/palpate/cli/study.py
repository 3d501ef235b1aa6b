"""`palpate study …`: the studies, as tables on the terminal, as JSON and as files of results."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.text import Text

from palpate.cli.command import command
from palpate.cli.console import Ticker, err
from palpate.cli.options import (
    AsJson,
    BaseUrl,
    CriticModel,
    NoiseLevel,
    Request,
    RobotConfig,
    Widths,
    widths,
)

if TYPE_CHECKING:
    from palpate.studies.accuracy import Question
    from palpate.studies.campaign.campaign import Order
    from palpate.studies.planners.attempt import Conditions
    from palpate.studies.scores.kept import Runs

app = typer.Typer(
    no_args_is_help=True,
    help="Run a study: accuracy, variety, efficiency, ablation, repeatability, faults, deceptions.",
)

CORES = os.cpu_count() or 1

Names = Annotated[list[str] | None, typer.Argument(metavar="[SCENARIO]...")]
Tasks = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[SCENARIO]...", help="all | kinds (one of each kind) | names [bottle_and_table]"
    ),
]
FIRST = ["bottle_and_table"]
Seeds = Annotated[int, typer.Option("--seeds", min=1)]
Seed = Annotated[int, typer.Option("--seed", min=0)]
Workers = Annotated[int, typer.Option("--workers", help="Processes.", min=1)]
Planners = Annotated[
    list[str],
    typer.Option("--planner", help="Planner to study, e.g. openai:MODEL; may be repeated."),
]
Trials = Annotated[int, typer.Option("--trials", min=1)]
InFlight = Annotated[int, typer.Option("--workers", help="Requests in flight.", min=1, max=64)]
Results = Annotated[
    Path, typer.Option("--out", help="File the results are appended to; run again to go on.")
]
Images = Annotated[
    list[Path] | None, typer.Option("--image", help="Picture (default: rendered from the world).")
]
Prompts = Annotated[
    list[str] | None,
    typer.Option("--prompt", metavar="full|lean", help="Which prompt [full]; may be repeated."),
]
Feedback = Annotated[
    int, typer.Option("--feedback", min=0, max=10, help="Rounds of feedback; the paper has none.")
]
Dollars = Annotated[
    float,
    typer.Option("--budget-dollars", min=0, help="Most that one plan may cost, by list prices."),
]


@dataclass(frozen=True)
class AskedOptions:
    """What scenarios are run with, besides what they say themselves."""

    noise: NoiseLevel = "lab"
    request: Request = None
    within: Widths = None
    robot_config: RobotConfig = None

    def changes(self) -> dict[str, Any]:
        """As fields of the settings."""
        found: dict[str, Any] = {"noise": self.noise}
        if self.request is not None:
            found["request"] = self.request
        if self.within:
            found["within"] = widths(self.within)
        if self.robot_config is not None:
            found["robot_config"] = self.robot_config.absolute()
        return found


@dataclass(frozen=True)
class SeedOptions:
    """Over which seeds, by whom, and where they are kept."""

    seeds: Seeds = 20
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
        from palpate.studies.engine.cluster import crew
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
            err.print(Text(f"page: {page}", "dim"), soft_wrap=True)


@dataclass(frozen=True)
class TrialOptions:
    """What all trials of a study of planners share."""

    image: Images = None
    noise: NoiseLevel = "lab"
    base_url: BaseUrl = None
    feedback: Feedback = 0
    budget_dollars: Dollars = 2
    prompt: Prompts = None
    critic: CriticModel = None

    def conditions(self) -> Conditions:
        """As the studies take them."""
        from palpate.studies.planners.attempt import Conditions
        from palpate.tools import model_settings

        asking = model_settings(
            self.base_url, rounds=self.feedback, critic=self.critic, dollars=self.budget_dollars
        )
        return Conditions(tuple(self.image or ()), self.noise, asking)


@dataclass(frozen=True)
class FaultOptions:
    """What is to go wrong, besides the mishaps."""

    kind: Annotated[
        str,
        typer.Option(
            "--kind",
            help="mishaps, plans, nasty, runtime, signals, poses, obstacles, "
            "cautious, light or inputs.",
        ),
    ] = "mishaps"
    count: Annotated[
        int | None, typer.Option("--count", min=1, help="Cases (plans: 10000 to be checked).")
    ] = None
    execute: Annotated[
        int, typer.Option("--execute", min=0, help="Of --kind plans: how many are executed.")
    ] = 0
    bypass_check: Annotated[
        bool, typer.Option("--bypass-check", help="As many again of those that are refused.")
    ] = False
    seed: Seed = 0
    case: Annotated[
        str | None, typer.Option("--case", help="Repeat one case, by its number or name.")
    ] = None
    out: Annotated[Path | None, typer.Option("--out", help="Folder of the rows and the page.")] = (
        None
    )

    def order(self, workers: int) -> Order:
        """As the campaign takes it."""
        from palpate.errors import InputError
        from palpate.studies.campaign.campaign import Order

        if self.out is None:
            raise InputError("a campaign needs a folder for its rows and its page; give one, out=")
        return Order(self.out, self.count, self.execute, self.bypass_check, self.seed, workers)


@command(app)
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

    With --out every run is kept as soon as it is done, and what is there is not run again.
    """
    from palpate.cli.show.studies import show_seed_runs
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


@command(app)
def variety(
    *, noise: NoiseLevel = "lab", seed: Seed = 0, workers: Workers = CORES, as_json: AsJson = False
) -> None:
    """Ten scenes of other objects, heights and gaps, one run each."""
    from palpate.cli.show.studies import show_seed_runs
    from palpate.studies.variety import run_all

    runs = {name: [run] for name, run in run_all(noise, seed, workers).items()}
    show_seed_runs(runs, f"--noise {noise}", as_json)


@command(app)
def efficiency(
    names: Names = None,
    *,
    noise: NoiseLevel = "lab",
    seed: Seed = 0,
    plot: Annotated[Path | None, typer.Option("--plot", help="HTML file for the plot.")] = None,
    as_json: AsJson = False,
) -> None:
    """Actions and robot time of the symbolic planner against the exhaustive one."""
    from palpate.cli.show.studies import show_comparisons
    from palpate.studies import efficiency

    found = efficiency.efficiency(names or efficiency.comparable(), noise, seed)
    if plot:
        plot.write_text(efficiency.plot(found), encoding="utf-8")
    show_comparisons(found, efficiency.PAPER, as_json)


@command(app)
def ablation(
    names: Tasks = None,
    *,
    out: Results,
    planner: Planners,
    trials: Trials = 10,
    workers: InFlight = 4,
    configuration: Annotated[
        list[str] | None, typer.Option("--configuration", help="Default: all.")
    ] = None,
    shared: TrialOptions,
    as_json: AsJson = False,
) -> None:
    """The paper's table II: what each part of the prompt is worth.

    A page beside the results shows the paper's tables and these.
    """
    from palpate.cli.show.studies import show_trials
    from palpate.studies.planners import ablation

    configurations = configuration or ablation.CONFIGURATIONS
    conditions = shared.conditions()
    try:
        found = ablation.ablation(
            names or FIRST,
            planner,
            out,
            conditions,
            trials,
            configurations,
            workers,
            _say,
            shared.prompt or ["full"],
        )
    finally:
        _page(out)
    show_trials(found, ablation.published(), as_json)


@command(app)
def repeatability(
    names: Tasks = None,
    *,
    out: Results,
    planner: Planners,
    trials: Trials = 20,
    workers: InFlight = 4,
    shared: TrialOptions,
    as_json: AsJson = False,
) -> None:
    """The paper's table III: the same task over and over.

    A page beside the results shows the paper's tables and these.
    """
    from palpate.cli.show.studies import show_trials
    from palpate.studies.planners import repeatability

    conditions = shared.conditions()
    try:
        found = repeatability.repeatability(
            names or FIRST,
            planner,
            out,
            conditions,
            trials,
            workers,
            _say,
            shared.prompt or ["full"],
        )
    finally:
        _page(out)
    show_trials(found, repeatability.published(), as_json)


@command(app)
def faults(
    names: Names = None,
    *,
    noise: NoiseLevel = "lab",
    seeds: Seeds = 5,
    workers: Workers = CORES,
    campaign: FaultOptions,
    as_json: AsJson = False,
) -> None:
    """What goes wrong on purpose: how it ends, and whether anything is hit, dropped or lost.

    Mishaps are bundled scenarios. Every other --kind is a campaign: its cases are appended to the
    folder --out, where a page shows them; run again to go on. Forces come from MuJoCo's own state
    at every physics step.
    """
    from palpate.cli.show.studies import show_campaign, show_case, show_endings
    from palpate.studies import faults
    from palpate.studies.campaign.campaign import conduct, repeat

    if campaign.case is not None:
        show_case(repeat(campaign.kind, campaign.case, campaign.seed), as_json)
        return
    if campaign.kind == "mishaps":
        endings = faults.faults(names or faults.mishaps(), noise, range(seeds), workers)
        show_endings(endings, as_json)
        return
    show_campaign(conduct(campaign.kind, campaign.order(workers), _say), as_json)


@command(app)
def deceptions(
    names: Annotated[list[str] | None, typer.Argument(metavar="[WORLD]...")] = None,
    *,
    out: Annotated[Path, typer.Option("--out", help="Folder of the rows and the page.")],
    noise: Annotated[
        list[str],
        typer.Option(
            "--noise",
            metavar="NAME|FILE.yaml",
            help="none | lab | datasheet | hardware | FILE.yaml | one of the study's own; may be repeated.",
        ),
    ] = ["lab"],  # noqa: B006 - typer's default of an option that may be repeated
    seed: Annotated[int, typer.Option("--seed", help="The first one.", min=0)] = 0,
    seeds: Seeds = 1,
    traces: Annotated[
        Path | None,
        typer.Option("--traces", help="Folder of traces: estimated anew where they lie there."),
    ] = None,
    workers: Workers = CORES,
    as_json: AsJson = False,
) -> None:
    """Worlds that deceive (tethers, magnets, mats, moving masses, jumps), innocent ones, and what
    cannot be told: what is answered, and whether it is right.

    An identified value must be within 4 of its standard deviations; a deceptive world may be
    contradicted or not identified just as well, an innocent one may not. Rows are appended to the
    folder --out, where a page shows them; run again to go on.
    """
    from palpate.cli.show.studies import show_deceptions
    from palpate.studies.deceptions import study, world

    chosen = study.cases(names or world.deceptions(), noise, range(seed, seed + seeds))
    show_deceptions(study.deceive(chosen, out, workers, traces, _say), as_json)


def _page(results: Path) -> None:
    """Write the page of trials beside their file, where there are any."""
    from palpate.studies.planners.page import write_page

    if page := write_page(results):
        _say(f"page: {page}")


def _say(line: str) -> None:
    err.print(Text(line, "dim"), soft_wrap=True)
