"""The command line. Heavy imports happen inside the commands, so that `--help` answers at once."""

from __future__ import annotations

import json
import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from palpate import __version__
from palpate.cli import study
from palpate.cli.exits import EXIT, exit_status, in_flags
from palpate.errors import PalpateError

if TYPE_CHECKING:
    from palpate.planning.model.session import ModelSettings
    from palpate.settings import Settings

app = typer.Typer(
    name="palpate",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Physics-accurate digital twins by touch: say what you want to simulate, and a robot measures only what your "
    "MuJoCo scene does not know yet.",
    epilog="Exit status: 0 every parameter estimated · 1 finished, but a parameter is not identified · 2 bad input · "
    "3 no plan (the explanation says why) · 4 stopped safely during execution · 5 planner or robot unavailable.",
)
app.add_typer(study.app, name="study")


class Noise(StrEnum):
    """Sensor worlds."""

    none = "none"
    lab = "lab"
    datasheet = "datasheet"


Request = Annotated[
    str | None, typer.Option("-r", "--request", help="What you want to simulate, in your words.")
]
SceneFile = Annotated[
    Path | None, typer.Option("--scene", help="Your MJCF; what is absent or '?' is unknown.")
]
Images = Annotated[
    list[Path] | None, typer.Option("--image", help="Picture of the workspace; may be repeated.")
]
Poses = Annotated[
    Path | None, typer.Option("--poses", help="poses.yaml: objects, places, offsets.")
]
World = Annotated[
    Path | None, typer.Option("--world", help="MJCF of the hidden world of the embedded robot.")
]
RobotUrl = Annotated[
    str | None, typer.Option("--robot", help="URL of a real robot instead of the embedded one.")
]
Planner = Annotated[
    str, typer.Option("--planner", help="symbolic | exhaustive | replay:FILE | PROVIDER:MODEL")
]
NoiseLevel = Annotated[Noise, typer.Option("--noise", help="Sensor world of the embedded robot.")]
Seed = Annotated[int, typer.Option("--seed", help="Seed of everything random.")]
Out = Annotated[
    Path | None, typer.Option("--out", help="Run folder to make (default: runs/NAME-TIME).")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]
BaseUrl = Annotated[str | None, typer.Option("--base-url", help="Address of the model's server.")]
Native = Annotated[bool, typer.Option("--native", help="Ask for the provider's structured output.")]
Without = Annotated[
    list[str] | None,
    typer.Option(
        "--without", metavar="MODULE", help="Part of the prompt to leave out; may be repeated."
    ),
]
Feedback = Annotated[
    int, typer.Option("--feedback", min=0, max=10, help="How often findings go back to the model.")
]
Seconds = Annotated[
    float, typer.Option("--budget-seconds", min=1, help="Longest that a model may take for a plan.")
]
Tokens = Annotated[
    int, typer.Option("--budget-tokens", min=1, help="Most tokens that a plan may take.")
]
Dollars = Annotated[
    float,
    typer.Option("--budget-dollars", min=0, help="Most that a plan may cost, by list prices."),
]
Yes = Annotated[bool, typer.Option("--yes", help="Do not ask before a real robot moves.")]
Rehearse = Annotated[
    bool | None,
    typer.Option(
        "--rehearse/--no-rehearse",
        help="Execute in simulation first (default: only for a real robot).",
    ),
]
OnFailure = Annotated[
    str, typer.Option("--on-failure", help="stop | skip | replan: what to do when a leaf fails.")
]
Remeasure = Annotated[
    bool, typer.Option("--remeasure", help="Measure what is asked even if the scene states it.")
]


def main() -> None:
    """Entry point: every `PalpateError` becomes one line and its exit status."""
    try:
        sys.exit(app(standalone_mode=False))
    except PalpateError as error:
        fail(error)
    except typer.Abort:
        sys.exit(4)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(4)
    except Exception as error:
        if type(error).__module__.split(".")[0] in ("click", "typer"):
            usage(error)
        raise


def fail(error: PalpateError) -> NoReturn:
    """Print the error where it belongs and leave with its status."""
    status, message = exit_status(error), in_flags(str(error))
    if "--json" in sys.argv:
        print(
            json.dumps(
                {
                    "status": "rejected" if status == 3 else "failed",
                    "error": {"message": message, "exit_status": status},
                },
                ensure_ascii=False,
            )
        )
    print(f"palpate: {message}", file=sys.stderr)
    sys.exit(status)


def usage(error: Any) -> NoReturn:
    """A wrong option or argument: the command line library's own message."""
    show = getattr(error, "show", None)
    if show:
        show()
    else:
        print(f"palpate: {error}", file=sys.stderr)
    sys.exit(getattr(error, "exit_code", 2))


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


@app.command()
def demo(
    name: Annotated[str, typer.Argument(metavar="[SCENARIO]")] = "bottle_and_table",
    noise: NoiseLevel = Noise.lab,
    seed: Seed = 0,
    planner: Annotated[str | None, typer.Option("--planner")] = None,
    out: Out = None,
    as_json: AsJson = False,
    base_url: BaseUrl = None,
    native: Native = False,
    feedback: Feedback = 3,
    budget_seconds: Seconds = 300,
    budget_tokens: Tokens = 200_000,
    budget_dollars: Dollars = 2,
) -> None:
    """Run a bundled scenario from the sentence to the report."""
    options = locals()
    from palpate.scenarios.catalogue import scenario

    changes: dict[str, Any] = {
        "noise": noise.value,
        "seed": seed,
        "out": out,
        "model_settings": _model_settings(options),
    }
    carry_out(
        scenario(name).settings(**changes, **({"planner": planner} if planner else {})), as_json
    )


@app.command()
def scenarios(as_json: AsJson = False) -> None:
    """List the bundled scenarios."""
    from palpate.cli.show import show_scenarios

    show_scenarios(as_json)


@app.command()
def run(
    request: Request = None,
    scene: SceneFile = None,
    image: Images = None,
    poses: Poses = None,
    world: World = None,
    robot: RobotUrl = None,
    planner: Planner = "symbolic",
    noise: NoiseLevel = Noise.lab,
    seed: Seed = 0,
    out: Out = None,
    as_json: AsJson = False,
    yes: Yes = False,
    remeasure: Remeasure = False,
    rehearse: Rehearse = None,
    on_failure: OnFailure = "stop",
    base_url: BaseUrl = None,
    native: Native = False,
    without: Without = None,
    feedback: Feedback = 3,
    budget_seconds: Seconds = 300,
    budget_tokens: Tokens = 200_000,
    budget_dollars: Dollars = 2,
) -> None:
    """Measure what is missing and write the twin and the report."""
    carry_out(_settings(locals()), as_json, yes)


@app.command()
def gap(
    scene: Annotated[Path, typer.Argument(help="Your MJCF.")],
    poses: Poses = None,
    as_json: AsJson = False,
) -> None:
    """Show what a scene states and what is missing."""
    from palpate.cli.show import show_gap
    from palpate.scene.load import load_scene

    show_gap(load_scene(scene, poses), as_json)


@app.command()
def plan(
    request: Request = None,
    scene: SceneFile = None,
    image: Images = None,
    poses: Poses = None,
    world: World = None,
    planner: Planner = "symbolic",
    remeasure: Remeasure = False,
    out: Annotated[Path | None, typer.Option("--out", help="File to write the plan to.")] = None,
    as_json: AsJson = False,
    base_url: BaseUrl = None,
    native: Native = False,
    without: Without = None,
    feedback: Feedback = 3,
    budget_seconds: Seconds = 300,
    budget_tokens: Tokens = 200_000,
    budget_dollars: Dollars = 2,
) -> None:
    """Plan only: which parameters, which tree, and why."""
    from palpate import pipeline
    from palpate.cli.show import show_plan

    settings = _settings({**locals(), "out": None}).checked()
    made = pipeline.plan(settings, pipeline.load(settings))
    show_plan(made, as_json, out)
    raise typer.Exit(0 if made.plan.satisfied or made.ready else 3)


@app.command()
def prompt(
    request: Request = None,
    scene: SceneFile = None,
    poses: Poses = None,
    image: Images = None,
    without: Without = None,
    as_json: AsJson = False,
) -> None:
    """Print what a model would be sent, to read it or to paste it into a chat."""
    from palpate.cli.show import show_prompt

    show_prompt(_settings(locals()).checked(), as_json)


@app.command()
def check(
    plan: Annotated[
        Path, typer.Argument(metavar="PLAN", help="A plan, a chat's answer, or a run folder.")
    ],
    scene: SceneFile = None,
    poses: Poses = None,
    as_json: AsJson = False,
) -> None:
    """Check a plan against the vocabulary and a scene."""
    from palpate.cli.show import check_plan_file

    raise typer.Exit(check_plan_file(plan, scene, poses, as_json))


@app.command()
def execute(
    plan: Annotated[
        Path, typer.Argument(metavar="PLAN", help="A plan, a chat's answer, or a run folder.")
    ],
    scene: SceneFile = None,
    poses: Poses = None,
    world: World = None,
    robot: RobotUrl = None,
    noise: NoiseLevel = Noise.lab,
    seed: Seed = 0,
    out: Out = None,
    as_json: AsJson = False,
    yes: Yes = False,
    rehearse: Rehearse = None,
    on_failure: OnFailure = "stop",
) -> None:
    """Execute a plan that exists already."""
    from palpate.planning.recorded import plan_file

    carry_out(_settings({**locals(), "planner": f"replay:{plan_file(plan)}"}), as_json, yes)


@app.command()
def vocabulary(
    as_json: Annotated[bool, typer.Option("--json", help="The JSON schema of a plan.")] = False,
    btcpp: Annotated[bool, typer.Option("--btcpp", help="BT.CPP 4 TreeNodesModel.")] = False,
) -> None:
    """Print the primitives and composites that plans are made of."""
    from palpate.cli.show import show_vocabulary

    show_vocabulary(as_json, btcpp)


@app.command()
def doctor() -> None:
    """Explain what is and what is not available on this machine."""
    from palpate.cli.doctor import examine

    raise typer.Exit(examine())


def _settings(options: dict[str, Any]) -> Settings:
    from palpate.settings import Settings

    fields = {k: v for k, v in options.items() if k in Settings.__dataclass_fields__}
    fields["images"] = tuple(options.get("image") or ())
    fields["model_settings"] = _model_settings(options)
    if "noise" in fields:
        fields["noise"] = fields["noise"].value
    return Settings(**fields)


def _model_settings(options: dict[str, Any]) -> ModelSettings:
    """How a model is asked, by the options of a command; defaults for what it does not have."""
    from palpate.planning.model.prompt.compose import checked_modules
    from palpate.planning.model.session import Budget, ModelSettings

    budget = {
        name: options[f"budget_{name}"]
        for name in ("seconds", "tokens", "dollars")
        if f"budget_{name}" in options
    }
    given = {name: options[name] for name in ("base_url", "native") if name in options}
    rounds = {"rounds": options["feedback"]} if "feedback" in options else {}
    return ModelSettings(
        **given,
        **rounds,
        without=checked_modules(options.get("without") or ()),
        budget=Budget(**budget),
    )


def carry_out(settings: Settings, as_json: bool, yes: bool = False) -> None:
    """Run with a live view on stderr, print the result, leave with its exit status."""
    from palpate.cli.show import confirm_plan, live_view, show_outcome
    from palpate.pipeline import run as run_pipeline
    from palpate.pipeline import unasked

    with live_view() as (observer, say):
        made = run_pipeline(settings, observer, say, unasked if yes else confirm_plan)
    show_outcome(made, as_json)
    raise typer.Exit(EXIT[made.status])


if __name__ == "__main__":
    main()
