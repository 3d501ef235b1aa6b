"""Commands that run a plan: from a scenario, from a sentence, from a plan that exists already."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.cli.commands.asking import resuming, unless
from palpate.cli.options.model import ModelOptions, Planner, Remeasure, Without
from palpate.cli.options.motion import (
    Cautious,
    Fast,
    MotionOptions,
    NoiseLevel,
    Out,
    RobotConfig,
    Seed,
    WatchOptions,
    Yes,
)
from palpate.cli.options.results import AsJson, PlanFile, Widths, widths
from palpate.cli.options.scene import DEFAULT_ARM, Arm, GivenScene, SceneOptions
from palpate.interrupt import interrupts

if TYPE_CHECKING:
    from palpate.settings import Settings


def _scenario_names(begun: str) -> list[str]:
    """Names of bundled scenarios that begin so, for a shell to complete."""
    from palpate.scenarios.catalogue import scenarios

    return [name for name in scenarios() if name.startswith(begun)]


def demo(
    name: Annotated[
        str, typer.Argument(metavar="[SCENARIO]", autocompletion=_scenario_names)
    ] = "bottle_and_table",
    *,
    noise: NoiseLevel = "lab",
    seed: Seed = 0,
    planner: Annotated[str | None, typer.Option("--planner")] = None,
    arm: Arm = DEFAULT_ARM,
    cautious: Cautious = False,
    robot_config: RobotConfig = None,
    within: Widths = None,
    out: Out = None,
    fast: Fast = False,
    watch: WatchOptions,
    as_json: AsJson = False,
    model: ModelOptions,
) -> None:
    """Run a bundled scenario from the sentence to the report."""
    from palpate.scenarios.catalogue import scenario

    chosen = scenario(name)
    settings = chosen.settings(
        planner=planner or chosen.planner,
        noise=noise,
        seed=seed,
        arm=arm,
        cautious=cautious,
        robot_config=robot_config,
        within=widths(within),
        out=out,
        fast=fast,
        model_settings=model.settings(),
    )
    carry_out(settings, as_json, watch)


def run(
    *,
    asked: SceneOptions,
    planner: Planner = "symbolic",
    remeasure: Remeasure = False,
    within: Widths = None,
    motion: MotionOptions,
    watch: WatchOptions,
    as_json: AsJson = False,
    yes: Yes = False,
    without: Without = None,
    model: ModelOptions,
) -> None:
    """Measure what is missing and write the twin and the report."""
    settings = replace(
        motion.added_to(asked.settings()),
        planner=planner,
        remeasure=remeasure,
        within=widths(within),
        model_settings=model.settings(without),
    )
    carry_out(settings, as_json, watch, yes)


def execute(
    plan: PlanFile,
    *,
    given: GivenScene,
    motion: MotionOptions,
    watch: WatchOptions,
    as_json: AsJson = False,
    yes: Yes = False,
) -> None:
    """Execute a plan that exists already."""
    from palpate.settings import Settings
    from palpate.tools import replayed

    settings = Settings(
        scene=given.scene,
        poses=given.poses,
        root=given.root,
        robot_body=tuple(given.robot_body or ()),
        arm=given.arm,
        planner=replayed(plan),
    )
    carry_out(motion.added_to(settings), as_json, watch, yes)


def carry_out(settings: Settings, as_json: bool, watch: WatchOptions, yes: bool = False) -> None:
    """Run with a live view on stderr, print the result, leave with its exit status."""
    from palpate.api import run_settings
    from palpate.callbacks import RunCallbacks
    from palpate.cli.show.run import (
        ValuesFirst,
        confirm_plan,
        groot,
        live_page,
        live_view,
        pace,
        play_again,
        show_ended,
        warn_of_invented,
    )

    with (
        interrupts() as signals,
        signals.noted(),
        live_page(watch.live) as page,
        groot(watch) as publisher,
    ):
        warn_of_invented(settings)
        may_move = unless(yes, page.confirm if page else confirm_plan)
        with live_view(page, publisher, pace(watch, settings)) as (observer, say):
            values = ValuesFirst(as_json)
            callbacks = RunCallbacks(observer, say, may_move, resuming(say), values)
            done = run_settings(settings, callbacks)
        status = show_ended(done, as_json, values.shown)
        if page and not signals.count:
            play_again(page, done, signals)
        raise typer.Exit(status)
