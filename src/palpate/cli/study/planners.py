"""Studies of planners that are models: the paper's tables."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.console import aside
from palpate.cli.options import AsJson
from palpate.cli.study.options import (
    FIRST,
    InFlight,
    OfTrials,
    Planners,
    Prompts,
    Results,
    Tasks,
    Trials,
    conditions,
)


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
    shared: OfTrials,
    prompt: Prompts = None,
    as_json: AsJson = False,
) -> None:
    """The paper's table II: ablation of the parts of the prompt.

    A page beside the results shows the paper's tables and these.
    """
    from palpate.cli.show.studies.planners import show_trials
    from palpate.studies.planners import ablation as studies

    asked = conditions(shared)
    with _page_beside(out):
        found = studies.ablation(
            names or FIRST,
            planner,
            out,
            asked,
            trials,
            configurations=configuration or studies.CONFIGURATIONS,
            in_flight=workers,
            say=aside,
            prompts=prompt or ["full"],
        )
    show_trials(found, studies.published_ablation(), as_json)


def repeatability(
    names: Tasks = None,
    *,
    out: Results,
    planner: Planners,
    trials: Trials = 20,
    workers: InFlight = 4,
    shared: OfTrials,
    prompt: Prompts = None,
    as_json: AsJson = False,
) -> None:
    """The paper's table III: repeated trials of the same task.

    A page beside the results shows the paper's tables and these.
    """
    from palpate.cli.show.studies.planners import show_trials
    from palpate.studies.planners import ablation as studies

    asked = conditions(shared)
    with _page_beside(out):
        found = studies.repeatability(
            names or FIRST,
            planner,
            out,
            asked,
            trials,
            in_flight=workers,
            say=aside,
            prompts=prompt or ["full"],
        )
    show_trials(found, studies.published_repeatability(), as_json)


@contextmanager
def _page_beside(results: Path) -> Generator[None]:
    """The page of trials is written beside their file however they end, where there are any."""
    from palpate.studies.planners.page import write_page

    try:
        yield
    finally:
        if page := write_page(results):
            aside(f"page: {page}")
