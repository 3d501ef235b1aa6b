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
    """The paper's table II: what each part of the prompt is worth.

    A page beside the results shows the paper's tables and these.
    """
    from palpate.cli.show.studies.planners import show_trials
    from palpate.studies.planners import ablation

    configurations = configuration or ablation.CONFIGURATIONS
    asked = conditions(shared)
    with _page_beside(out):
        found = ablation.ablation(
            names or FIRST,
            planner,
            out,
            asked,
            trials,
            configurations,
            workers,
            aside,
            prompt or ["full"],
        )
    show_trials(found, ablation.published(), as_json)


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
    """The paper's table III: the same task over and over.

    A page beside the results shows the paper's tables and these.
    """
    from palpate.cli.show.studies.planners import show_trials
    from palpate.studies.planners import repeatability

    asked = conditions(shared)
    with _page_beside(out):
        found = repeatability.repeatability(
            names or FIRST,
            planner,
            out,
            asked,
            trials,
            workers,
            aside,
            prompt or ["full"],
        )
    show_trials(found, repeatability.published(), as_json)


@contextmanager
def _page_beside(results: Path) -> Generator[None]:
    """The page of trials is written beside their file however they end, where there are any."""
    from palpate.studies.planners.page import write_page

    try:
        yield
    finally:
        if page := write_page(results):
            aside(f"page: {page}")
