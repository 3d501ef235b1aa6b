"""The commands. Heavy imports happen inside the commands, so that `--help` answers at once."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate import __version__
from palpate.cli import study
from palpate.cli.command import command
from palpate.cli.options import (
    DEFAULT_ARM,
    Arm,
    ArmOptions,
    AsJson,
    BaseUrl,
    Cautious,
    EstimatorNames,
    Fast,
    GivenScene,
    Images,
    ModelOptions,
    MotionOptions,
    NoiseLevel,
    Out,
    PlanFile,
    Planner,
    Poses,
    PromptStyle,
    Remeasure,
    RobotBody,
    RobotConfig,
    RobotUrl,
    Root,
    RunFolder,
    SceneOptions,
    Seconds,
    Seed,
    WatchOptions,
    Widths,
    Without,
    World,
    Yes,
    scenario_names,
    widths,
)
from palpate.interrupt import interrupts

if TYPE_CHECKING:
    from palpate.runs.run import Run
    from palpate.settings import Settings

app = typer.Typer(
    name="palpate",
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Physics-accurate digital twins by touch: say what you want to simulate, and a robot measures only what your "
    "MuJoCo scene does not know yet.",
    epilog="Exit status: 0 every parameter identified · 1 finished, but a parameter is not, or wider than "
    "--within asks · 2 bad input · 3 no plan (the explanation says why) · 4 interrupted, or stopped safely · "
    "5 planner or robot unavailable.",
)
app.add_typer(study.app, name="study")

EVERYTHING_SEEN = "I want to simulate everything in this picture. What does each thing weigh?"
"""What a model is asked that shall see a scene."""


def _version(value: bool) -> None:
    if value:
        print(f"palpate {__version__}")
        raise typer.Exit


@app.callback()
def root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Options of palpate itself."""


@command(app)
def demo(
    name: Annotated[
        str, typer.Argument(metavar="[SCENARIO]", autocompletion=scenario_names)
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


@command(app)
def scenarios(as_json: AsJson = False) -> None:
    """List the bundled scenarios."""
    from palpate.cli.show.catalogue import show_scenarios

    show_scenarios(as_json)


@command(app)
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


@command(app)
def init(
    folder: Annotated[Path, typer.Argument(help="Folder to write scene.xml and poses.yaml into.")],
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[OBJECT]...", help="What stands there.")
    ] = None,
    *,
    surface: Annotated[str, typer.Option("--surface", help="What it stands on.")] = "table",
    images: Images = None,
    poses: Poses = None,
    planner: Planner = "symbolic",
    as_json: AsJson = False,
    model: ModelOptions,
) -> None:
    """Begin a scene of your own: commented files, from names, or from a picture that a model looks at."""
    from palpate.cli.show.scene import show_scaffold
    from palpate.settings import Settings
    from palpate.tools import new_scene, scene_from_picture

    if not images:
        show_scaffold(new_scene(folder, names or ["mug"], surface), as_json)
        return
    settings = Settings(
        request=EVERYTHING_SEEN,
        images=tuple(images),
        poses=poses,
        planner=planner,
        model_settings=model.settings(),
    )
    show_scaffold(scene_from_picture(settings, folder), as_json)


@command(app)
def gap(
    scene: Annotated[Path, typer.Argument(help="Your MJCF.")],
    *,
    poses: Poses = None,
    root: Root = None,
    robot_body: RobotBody = None,
    arm: Arm = DEFAULT_ARM,
    as_json: AsJson = False,
) -> None:
    """Show what a scene states and what is missing."""
    import palpate as pp
    from palpate.cli.show.scene import show_gap

    show_gap(pp.load(scene, poses, arm, root=root, robot_body=robot_body or ()), as_json)


@command(app)
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


@command(app)
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


@command(app)
def check(plan: PlanFile, *, given: GivenScene, as_json: AsJson = False) -> None:
    """Check a plan against the vocabulary and a scene."""
    from palpate.cli.show.plan import show_findings
    from palpate.tools import check_file

    robots = given.robot_body or ()
    findings = check_file(plan, given.scene, given.poses, given.arm, given.root, robots)
    show_findings(findings, as_json)
    raise typer.Exit(3 if findings else 0)


@command(app)
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


@command(app)
def report(
    folder: RunFolder,
    *,
    as_json: AsJson = False,
) -> None:
    """Finish a run that was cut off, or was in a hurry (--fast), and write its report anew."""
    from palpate.api import finish
    from palpate.cli.show.run import live_view, show_ended

    with interrupts() as signals, signals.noted():
        with live_view() as (_, say):
            done = finish(folder, say)
        raise typer.Exit(show_ended(done, as_json))


@command(app)
def estimate(
    folder: RunFolder, *, estimator: EstimatorNames = None, as_json: AsJson = False
) -> None:
    """Make the estimates of a stored trace anew: nothing moves, and the run folder stays as it is."""
    import palpate as pp
    from palpate.cli.options import by_quantity
    from palpate.cli.show.run import show_run

    found = pp.open(folder).estimate(by_quantity("estimator", estimator or ()))
    show_run(found, as_json)
    raise typer.Exit(0 if all(one.identified for one in found.estimates) else 1)


@command(app)
def fuse(
    folders: Annotated[
        list[Path], typer.Argument(metavar="RUN RUN…", help="Run folders of one scene.")
    ],
    *,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Folder for result.json and twin.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Make one estimate of several runs; what they have in common is not averaged away."""
    import palpate as pp
    from palpate.cli.show.stored import show_fusion

    fusion = pp.fuse(folders)
    if out is not None:
        fusion = fusion.save(out)
    show_fusion(fusion, as_json)
    raise typer.Exit(0 if fusion.identified else 1)


@command(app)
def compare(
    folders: Annotated[
        list[Path], typer.Argument(metavar="RUN RUN…", help="Run folders of the same things.")
    ],
    *,
    as_json: AsJson = False,
) -> None:
    """Show what several runs say of the same parameters, and how far they are apart."""
    import palpate as pp
    from palpate.cli.show.comparison import show_comparison
    from palpate.runs.compare import compare_runs

    show_comparison(compare_runs([pp.open(folder) for folder in folders]), as_json)


@command(app, name="open")
def open_report(
    folder: RunFolder,
    *,
    live: Annotated[
        bool, typer.Option("--live", help="Play the run again on a page instead.")
    ] = False,
) -> None:
    """Open a run's report in the browser."""
    import palpate as pp
    from palpate.cli.show.browser import show_report
    from palpate.cli.show.run import live_page, play_again

    if not live:
        show_report(folder)
        return
    with interrupts() as signals, signals.noted(), live_page(live) as page:
        assert page is not None
        play_again(page, pp.open(folder), signals)


@command(app)
def export(
    folder: RunFolder,
    *,
    to: Annotated[str, typer.Option("--to", metavar="FORMAT", help="mjcf | urdf | usd")],
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Folder to make (default: RUN/export-FORMAT)."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Hand a run's twin to another simulator; what is written is read back and compared."""
    import palpate as pp
    from palpate.cli.show.stored import show_export

    run = pp.open(folder)
    show_export(run, run.export(to, out), as_json)


@command(app)
def vocabulary(
    as_json: Annotated[bool, typer.Option("--json", help="The JSON schema of a plan.")] = False,
    btcpp: Annotated[bool, typer.Option("--btcpp", help="BT.CPP 4 TreeNodesModel.")] = False,
) -> None:
    """Print the primitives and composites that plans are made of."""
    from palpate.cli.show.catalogue import show_vocabulary

    show_vocabulary(as_json, btcpp)


@command(app)
def calibrate(
    *,
    weight: Annotated[
        str | None,
        typer.Option("--weight", metavar="[OBJECT=]MASS", help="Known mass: 0.5kg±0.1g"),
    ] = None,
    gauge: Annotated[
        str | None,
        typer.Option("--gauge", metavar="[SURFACE=]HEIGHT", help="Known height: 50mm±0.01mm"),
    ] = None,
    own_weight: Annotated[
        bool, typer.Option("--own-weight", help="Let the arm weigh itself.")
    ] = False,
    out: Annotated[
        Path, typer.Option("--out", help="robot.yaml to write; its other figures stay.")
    ] = Path("robot.yaml"),
    which: ArmOptions,
    as_json: AsJson = False,
    yes: Yes = False,
) -> None:
    """Measure one very arm with what is known, and write robot.yaml."""
    from palpate.audience import Audience
    from palpate.calibration.calibrate import calibrate as carry_out_calibration
    from palpate.calibration.calibrate import wanted
    from palpate.cli.calibration import show_calibration
    from palpate.cli.show.run import confirm_plan, live_view

    asked = wanted(weight, gauge, own_weight)

    def confirm(run: Run) -> bool:
        return yes or confirm_plan(run)

    with live_view() as (observer, say):
        audience = Audience(observer, say, confirm)
        done = carry_out_calibration(which.settings(), asked, out, audience)
    show_calibration(done, as_json)


@command(app)
def teach(
    scene: Annotated[Path, typer.Argument(help="Your MJCF.")],
    *,
    robot: RobotUrl = None,
    poses: Poses = None,
    root: Root = None,
    arm: Arm = DEFAULT_ARM,
    out: Annotated[Path, typer.Option("--out", help="poses.yaml to write.")] = Path("poses.yaml"),
) -> None:
    """Say where things are: lead a robot's hand to them, or measure them with a ruler."""
    from palpate.cli.teach import give_lesson

    give_lesson(scene, robot, poses, root, arm, out)


@command(app)
def doctor(
    *,
    robot: RobotUrl = None,
    arm: Arm = DEFAULT_ARM,
    robot_config: RobotConfig = None,
    yes: Yes = False,
    planner: Annotated[
        str | None, typer.Option("--planner", help="A model's server to ask: PROVIDER[:MODEL].")
    ] = None,
    base_url: BaseUrl = None,
    budget_seconds: Seconds = 60,
) -> None:
    """Explain what is and what is not available on this machine, at a real robot, or at a model's server."""
    from palpate.cli.doctor import examine, examine_planner, examine_robot

    if planner is not None:
        raise typer.Exit(examine_planner(planner, base_url, budget_seconds))
    if robot is None:
        raise typer.Exit(examine())

    def may_hold() -> bool:
        return yes or typer.confirm("Let the arm hold itself for 5 s, to count cycles?", err=True)

    raise typer.Exit(examine_robot(robot, arm, robot_config, may_hold))


def carry_out(settings: Settings, as_json: bool, watch: WatchOptions, yes: bool = False) -> None:
    """Run with a live view on stderr, print the result, leave with its exit status."""
    from palpate.api import run_settings
    from palpate.audience import Audience
    from palpate.cli.show.run import (
        ValuesFirst,
        confirm_plan,
        confirm_resuming,
        groot,
        live_page,
        live_view,
        play_again,
        show_ended,
        warn_of_invented,
    )

    with (
        interrupts() as signals,
        signals.noted(),
        live_page(watch.live) as page,
        groot(watch, settings) as publisher,
    ):
        ask = page.confirm if page else confirm_plan

        def confirm(run: Run) -> bool:
            return yes or ask(run)

        warn_of_invented(settings)
        with live_view(page, publisher) as (observer, say):

            def may_resume(why: str) -> bool:
                say("the robot was stopped")
                return confirm_resuming(why)

            values = ValuesFirst(as_json)
            audience = Audience(observer, say, confirm, may_resume, values)
            done = run_settings(settings, audience)
        status = show_ended(done, as_json, values.shown)
        if page and not signals.count:
            play_again(page, done, signals)
        raise typer.Exit(status)
