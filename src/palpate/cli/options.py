"""The options of the commands: each declared once, and those that belong together in groups.

A group is a dataclass whose fields are options; a command that has a parameter of its type takes all
of them (see `palpate.cli.command`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.errors import InputError

if TYPE_CHECKING:
    from palpate.planning.model.settings import ModelSettings
    from palpate.quantities.precision.within import Within
    from palpate.settings import Settings


def scenario_names(begun: str) -> list[str]:
    """Names of bundled scenarios that begin so, for a shell to complete."""
    from palpate.scenarios.catalogue import scenarios

    return [name for name in scenarios() if name.startswith(begun)]


Request = Annotated[
    str | None, typer.Option("-r", "--request", help="What you want to simulate, in your words.")
]
SceneFile = Annotated[
    Path | None, typer.Option("--scene", help="Your MJCF; what is absent or '?' is unknown.")
]
Images = Annotated[
    list[Path] | None, typer.Option("--image", help="Picture of the workspace; may be repeated.")
]
Root = Annotated[
    Path | None,
    typer.Option(
        "--root",
        metavar="DIR",
        help="Folder that the scene's files may lie in (default: its repository, home or folder).",
    ),
]
RobotBody = Annotated[
    list[str] | None,
    typer.Option(
        "--robot-body",
        metavar="NAME",
        help="Body that the scene's own robot begins with, which the arm takes the place of, or 'none'; may be "
        "repeated (default: what actuators drive, or ends in a hand).",
    ),
]
Poses = Annotated[
    Path | None, typer.Option("--poses", help="poses.yaml: objects, places, offsets.")
]
Arm = Annotated[
    str,
    typer.Option("--arm", metavar="NAME|PATH/", help="Arm, by name or by a description's folder."),
]
DEFAULT_ARM = "fr3"
"""`robots.registry.DEFAULT`, written here so that a command's help need not load the robots."""
Cautious = Annotated[
    bool,
    typer.Option("--cautious", help="Move slowly everywhere: nothing unseen is hit hard."),
]
RobotConfig = Annotated[
    Path | None,
    typer.Option("--robot-config", help="robot.yaml: what was measured of this very arm."),
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
NoiseLevel = Annotated[
    str,
    typer.Option(
        "--noise",
        metavar="NAME|FILE.yaml",
        autocompletion=lambda: ["none", "lab", "datasheet", "hardware"],
        help="How the robot differs from its model: none | lab | datasheet | hardware | FILE.yaml",
    ),
]
Seed = Annotated[int, typer.Option("--seed", help="Seed of everything random.")]
Out = Annotated[
    Path | None, typer.Option("--out", help="Run folder to make (default: runs/NAME-TIME).")
]
TwinFile = Annotated[
    Path | None,
    typer.Option(
        "--twin",
        metavar="FILE.xml",
        help="Write the twin there, too, with the includes, meshes and pictures that it needs.",
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]
Live = Annotated[
    bool,
    typer.Option("--live", help="Show the run in the browser, and play it again when it is done."),
]
Groot = Annotated[
    bool,
    typer.Option(
        "--groot", help="Publish the tree for Groot2; a simulated arm then takes its time."
    ),
]
GrootPort = Annotated[
    int,
    typer.Option("--groot-port", metavar="PORT", min=1, max=65535, help="Where Groot2 connects."),
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
Fast = Annotated[
    bool,
    typer.Option("--fast", help="Leave out film and replay in the twin, which measure nothing."),
]
PlanFile = Annotated[
    Path, typer.Argument(metavar="PLAN", help="A plan, a chat's answer, or a run folder.")
]
RunFolder = Annotated[Path, typer.Argument(metavar="RUN", help="A run folder.")]
Widths = Annotated[
    list[str] | None,
    typer.Option(
        "--within",
        metavar="QUANTITY=VALUE",
        help="Measure until the 95 % interval reaches no farther than that to either side, e.g. mass=1g, com=2mm, "
        "friction=0.01, bottle.mass=1g; may be repeated. In kg g mg, m cm mm um, N/m kN/m; without a unit, SI.",
    ),
]
EstimatorNames = Annotated[
    list[str] | None,
    typer.Option(
        "--estimator",
        metavar="QUANTITY=NAME",
        help="Which estimator of a quantity, e.g. mass=single-shot; may be repeated.",
    ),
]
BaseUrl = Annotated[str | None, typer.Option("--base-url", help="Address of the model's server.")]
Native = Annotated[bool, typer.Option("--native", help="Ask for the provider's structured output.")]
Without = Annotated[
    list[str] | None,
    typer.Option(
        "--without", metavar="MODULE", help="Part of the prompt to leave out; may be repeated."
    ),
]
PromptStyle = Annotated[
    str,
    typer.Option(
        "--prompt",
        metavar="full|lean",
        help="Tell a model how quantities are measured, too, or only what there is and what is safe.",
    ),
]
CriticModel = Annotated[
    str | None,
    typer.Option(
        "--critic",
        metavar="PROVIDER:MODEL",
        help="A second model that reads the plan and may object to it once.",
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


@dataclass(frozen=True)
class SceneOptions:
    """What is asked, of which scene, for which arm."""

    given: Annotated[
        Path | None, typer.Argument(metavar="[SCENE]", help="Your MJCF, as --scene.")
    ] = None
    request: Request = None
    scene: SceneFile = None
    image: Images = None
    poses: Poses = None
    root: Root = None
    robot_body: RobotBody = None
    arm: Arm = DEFAULT_ARM

    def settings(self) -> Settings:
        """Settings with these, and defaults for everything else.

        Raises:
            InputError: two scenes.
        """
        from palpate.settings import Settings

        if self.given is not None and self.scene is not None:
            raise InputError(f"two scenes, '{self.given}' and '{self.scene}': give one")
        return Settings(
            request=self.request,
            scene=self.given or self.scene,
            images=tuple(self.image or ()),
            poses=self.poses,
            root=self.root,
            robot_body=tuple(self.robot_body or ()),
            arm=self.arm,
        )


@dataclass(frozen=True)
class GivenScene:
    """A scene that something is already known to be done in, and the arm."""

    scene: SceneFile = None
    poses: Poses = None
    root: Root = None
    robot_body: RobotBody = None
    arm: Arm = DEFAULT_ARM


@dataclass(frozen=True)
class MotionOptions:
    """Which arm moves, simulated or real, and how."""

    cautious: Cautious = False
    robot_config: RobotConfig = None
    world: World = None
    robot: RobotUrl = None
    noise: NoiseLevel = "lab"
    seed: Seed = 0
    rehearse: Rehearse = None
    on_failure: OnFailure = "stop"
    out: Out = None
    twin: TwinFile = None
    fast: Fast = False

    def added_to(self, settings: Settings) -> Settings:
        """Settings with these, and everything else as it was."""
        return replace(settings, **asdict(self))


@dataclass(frozen=True)
class WatchOptions:
    """Who watches a run, beside the terminal."""

    live: Live = False
    groot: Groot = False
    groot_port: GrootPort = 1667


@dataclass(frozen=True)
class ArmOptions:
    """Which arm is calibrated, simulated or real, and where; without a scene on a bench of its own."""

    scene: Annotated[
        Path | None,
        typer.Option("--scene", help="MJCF that states the weight's mass, the gauges' height."),
    ] = None
    poses: Poses = None
    world: World = None
    arm: Arm = DEFAULT_ARM
    robot: RobotUrl = None
    robot_config: RobotConfig = None
    noise: NoiseLevel = "lab"
    seed: Seed = 0
    cautious: Cautious = False

    def settings(self) -> Settings:
        """Settings with these, and defaults for everything else."""
        from palpate.settings import Settings

        return Settings(**asdict(self))


@dataclass(frozen=True)
class ModelOptions:
    """How a model is asked, where the planner is one."""

    base_url: BaseUrl = None
    native: Native = False
    prompt: PromptStyle = "full"
    critic: CriticModel = None
    feedback: Feedback = 3
    budget_seconds: Seconds = 300
    budget_tokens: Tokens = 200_000
    budget_dollars: Dollars = 2

    def settings(self, without: Without = None) -> ModelSettings:
        """As the planner takes them; `without` names modules of the prompt that are left out.

        Raises:
            InputError: no such module, prompt or provider.
        """
        from palpate.tools import model_settings

        return model_settings(
            self.base_url,
            self.native,
            without or (),
            self.feedback,
            self.prompt,
            self.critic,
            seconds=self.budget_seconds,
            tokens=self.budget_tokens,
            dollars=self.budget_dollars,
        )


def by_quantity(option: str, entries: Sequence[str], word: str = "NAME") -> dict[str, str]:
    """What `QUANTITY=WORD` entries of an option say, by quantity; `word` is what its help calls it.

    Raises:
        InputError: an entry that is none.
    """
    found: dict[str, str] = {}
    for entry in entries:
        quantity, equals, said = (part.strip() for part in entry.partition("="))
        if not (quantity and equals and said):
            raise InputError(f"--{option} takes QUANTITY={word}, not '{entry}'")
        found[quantity] = said
    return found


def widths(entries: Sequence[str] | None) -> Within:
    """How narrow intervals are asked to be.

    Raises:
        InputError: not of the form QUANTITY=VALUE, no such quantity or unit, or no positive number.
    """
    from palpate.tools import widths as read

    return read(by_quantity("within", entries or (), "VALUE"))
