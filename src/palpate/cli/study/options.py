"""Options that several studies share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.cli.console import Ticker, aside
from palpate.cli.options.model import BaseUrl, CriticModel
from palpate.cli.options.motion import NoiseLevel, RobotConfig
from palpate.cli.options.results import Widths, widths
from palpate.cli.options.scene import Request

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
Seed = Annotated[int, typer.Option("--seed", min=0)]
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
    """Settings of the scenarios, beside their own."""

    noise: NoiseLevel = "lab"
    request: Request = None
    within: Widths = None
    robot_config: RobotConfig = None

    def changes(self) -> dict[str, Any]:
        """Changed fields of the settings."""
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


@dataclass(frozen=True)
class TrialOptions:
    """Options of all trials in a study of planners."""

    image: Images = None
    noise: NoiseLevel = "lab"
    base_url: BaseUrl = None
    feedback: Feedback = 0
    budget_dollars: Dollars = 2
    prompt: Prompts = None
    critic: CriticModel = None

    def conditions(self) -> Conditions:
        """Conditions for the studies."""
        from palpate.studies.planners.attempt import Conditions
        from palpate.tools import model_settings

        asking = model_settings(
            self.base_url, rounds=self.feedback, critic=self.critic, dollars=self.budget_dollars
        )
        return Conditions(tuple(self.image or ()), self.noise, asking)
