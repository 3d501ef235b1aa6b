"""Commands about plans, none of which moves anything."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.options.model import ModelOptions, Planner, PromptStyle, Remeasure, Without
from palpate.cli.options.results import AsJson, PlanFile, Widths, widths
from palpate.cli.options.scene import GivenScene, SceneOptions, World


def plan(
    *,
    asked: SceneOptions,
    world: World = None,
    planner: Planner = "symbolic",
    remeasure: Remeasure = False,
    within: Widths = None,
    out: Annotated[Path | None, typer.Option("--out", help="File to write the plan to.")] = None,
    as_json: AsJson = False,
    without: Without = None,
    model: ModelOptions,
) -> None:
    """Plan only: which parameters, which tree, and why."""
    from palpate.api import plan_settings
    from palpate.cli.show.plan import show_plan

    settings = replace(
        asked.settings(),
        world=world,
        planner=planner,
        remeasure=remeasure,
        within=widths(within),
        model_settings=model.settings(without),
    )
    found = plan_settings(settings)
    show_plan(found, as_json, out)
    raise typer.Exit(0 if found.satisfied or found.made.ready else 3)


def prompt(
    *,
    asked: SceneOptions,
    style: PromptStyle = "full",
    without: Without = None,
    as_json: AsJson = False,
) -> None:
    """Print what a model would be sent, to read it or to paste it into a chat."""
    from palpate.cli.show.plan import show_prompt

    settings = replace(
        asked.settings(), model_settings=ModelOptions(prompt=style).settings(without)
    )
    show_prompt(settings, as_json)


def check(plan: PlanFile, *, given: GivenScene, as_json: AsJson = False) -> None:
    """Check a plan against the vocabulary and a scene."""
    from palpate.cli.show.plan import show_findings
    from palpate.tools import check_file

    robots = given.robot_body or ()
    findings = check_file(plan, given.scene, given.poses, given.arm, given.root, robots)
    show_findings(findings, as_json)
    raise typer.Exit(3 if findings else 0)


def vocabulary(
    as_json: Annotated[bool, typer.Option("--json", help="The JSON schema of a plan.")] = False,
    btcpp: Annotated[bool, typer.Option("--btcpp", help="BT.CPP 4 TreeNodesModel.")] = False,
) -> None:
    """Print the primitives and composites that plans are made of."""
    from palpate.cli.show.catalogue import show_vocabulary

    show_vocabulary(as_json, btcpp)
