"""Options that say which arm moves, simulated or real, and how."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.cli.options.scene import DEFAULT_ARM, Arm, Poses, World

if TYPE_CHECKING:
    from palpate.settings import Settings


Cautious = Annotated[
    bool,
    typer.Option("--cautious", help="Move slowly everywhere: nothing unseen is hit hard."),
]
RobotConfig = Annotated[
    Path | None,
    typer.Option("--robot-config", help="robot.yaml: what was measured of this very arm."),
]
RobotUrl = Annotated[
    str | None, typer.Option("--robot", help="URL of a real robot instead of the embedded one.")
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
Fast = Annotated[
    bool,
    typer.Option("--fast", help="Leave out film and replay in the twin, which measure nothing."),
]
Yes = Annotated[bool, typer.Option("--yes", help="Do not ask before a real robot moves.")]
Live = Annotated[
    bool,
    typer.Option(
        "--live",
        help="Show the run in the browser, at the pace of a real arm, and play it again when it is done.",
    ),
]
Groot = Annotated[
    bool,
    typer.Option("--groot", help="Publish the tree for Groot2, live."),
]
GrootPort = Annotated[
    int,
    typer.Option("--groot-port", metavar="PORT", min=1, max=65535, help="Where Groot2 connects."),
]


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
