"""Commands that execute: a scenario, a request, an existing plan."""

from __future__ import annotations

from typing import Annotated

import typer

from palpate.cli.options import (
    ASKED,
    LOOK,
    MODEL,
    MOTION,
    PLANNER,
    SCENE,
    AsJson,
    Fields,
    LiveView,
    PlanFile,
    SceneArgument,
    Yes,
    one_scene,
    settings,
)
from palpate.common.processes import interrupts
from palpate.runs.settings import Settings, settings_of

OF_DEMO = ("noise", "seed", "arm", "cautious", "robot_config", "within", "out", "fast")


def _scenario_names(begun: str) -> list[str]:
    """Complete the name of a bundled scenario for a shell."""
    from palpate.studies.scenarios.catalogue import scenarios

    return [name for name in scenarios() if name.startswith(begun)]


def demo(
    name: Annotated[
        str, typer.Argument(metavar="[SCENARIO]", autocompletion=_scenario_names)
    ] = "bottle_and_table",
    *,
    given: Annotated[Fields, settings(*OF_DEMO)],
    planner: Annotated[str | None, typer.Option("--planner")] = None,
    live: LiveView = False,
    as_json: AsJson = False,
    model: Annotated[Fields, settings(MODEL)],
) -> None:
    """Run a bundled scenario from the sentence to the report."""
    from palpate.studies.scenarios.catalogue import scenario

    chosen = scenario(name)
    asked = chosen.settings(planner=planner or chosen.planner, **given, **model)
    carry_out(asked, as_json, live)


def run(
    scene: SceneArgument = None,
    *,
    given: Annotated[Fields, settings(*ASKED, *LOOK, *PLANNER, *MOTION)],
    live: LiveView = False,
    as_json: AsJson = False,
    yes: Yes = False,
    model: Annotated[Fields, settings(MODEL)],
) -> None:
    """Measure what is missing and write the twin and the report."""
    carry_out(settings_of(**one_scene(scene, given), **model), as_json, live, yes)


def execute(
    plan: PlanFile,
    *,
    given: Annotated[Fields, settings("scene", *SCENE, *MOTION)],
    live: LiveView = False,
    as_json: AsJson = False,
    yes: Yes = False,
) -> None:
    """Execute an existing plan."""
    from palpate.runs.tools import plan_file

    carry_out(settings_of(**given, planner=f"replay:{plan_file(plan)}"), as_json, live, yes)


def carry_out(asked: Settings, as_json: bool, live: bool, yes: bool = False) -> None:
    """Run with a live view on stderr, print the result, and exit with its status."""
    from palpate.cli import show_run as show
    from palpate.cli.show_arms import confirm_seen
    from palpate.runs import pipeline
    from palpate.runs.callbacks import RunCallbacks, ignore, refuse
    from palpate.runs.stored import run_of

    with interrupts() as signals, signals.defer(), show.live_page(live) as page:
        # Questions go to the page if there is one, else to the terminal.
        show.warn_of_drawn_truth(asked)
        may_move = show.unless(yes, page.confirm if page else show.confirm_plan)
        planned = page.show_plan if page else ignore if yes else show.show_plan_early
        proposal = refuse if as_json else show.confirm_proposal
        # Run with the views and callbacks, then print the result.
        with show.live_view(page, show.pace(live, asked)) as (observer, say):
            values = show.ValuesFirst(as_json)
            callbacks = RunCallbacks(
                observer,
                say,
                may_move,
                proposal,
                may_resume=show.resuming(say),
                measured=values,
                planned=planned,
                looked=confirm_seen(ask=asked.robot is not None and not yes),
            )
            done = run_of(pipeline.run(asked, callbacks))
        status = show.show_result(done, as_json, values.shown)
        if page and not signals.count:
            show.play_again(page, done, signals)
        raise typer.Exit(status)
