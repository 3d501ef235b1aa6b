"""Commands about plans; none moves anything."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.options import (
    MODEL,
    PLANNER,
    SCENE,
    AsJson,
    Given,
    PlanFile,
    SceneArgument,
    one_scene,
    settings,
)
from palpate.settings import settings_of

ASKED = ("request", "measure", "scene", "images", *SCENE)


def plan(
    scene: SceneArgument = None,
    *,
    given: Annotated[Given, settings(*ASKED, "world", *PLANNER)],
    out: Annotated[Path | None, typer.Option("--out", help="File to write the plan to.")] = None,
    as_json: AsJson = False,
    model: Annotated[Given, settings(MODEL)],
) -> None:
    """Plan without execution: parameters, tree, explanation."""
    from palpate.api.at_once import plan_settings
    from palpate.cli.show.plan import show_plan

    found = plan_settings(settings_of(**one_scene(scene, given), **model))
    show_plan(found, as_json, out)
    raise typer.Exit(0 if found.satisfied or found.made.ready else 3)


def prompt(
    scene: SceneArgument = None,
    *,
    given: Annotated[Given, settings(*ASKED, "remeasure", f"{MODEL}.prompt", f"{MODEL}.without")],
    as_json: AsJson = False,
) -> None:
    """Print the prompt for a model, to read it or to paste it into a chat."""
    from palpate.cli.show.plan import show_prompt

    show_prompt(settings_of(**one_scene(scene, given)), as_json)


def check(
    plan: PlanFile, *, given: Annotated[Given, settings("scene", *SCENE)], as_json: AsJson = False
) -> None:
    """Check a plan against the vocabulary and a scene."""
    from palpate.cli.show.plan import show_findings
    from palpate.tools import check_file

    findings = check_file(plan, settings_of(**given))
    show_findings(findings, as_json)
    raise typer.Exit(3 if findings else 0)


def vocabulary(
    as_json: Annotated[bool, typer.Option("--json", help="The JSON schema of a plan.")] = False,
    btcpp: Annotated[bool, typer.Option("--btcpp", help="BT.CPP 4 TreeNodesModel.")] = False,
) -> None:
    """Print the primitives and composites that plans are made of."""
    from palpate.cli.show.catalogue import show_vocabulary

    show_vocabulary(as_json, btcpp)
