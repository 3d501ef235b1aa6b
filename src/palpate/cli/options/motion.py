"""Options: the arm, simulated or real, and its observers."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

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
    typer.Option(
        "--robot-config", metavar="FILE", help="robot.yaml: calibration of this very arm."
    ),
]
RobotUrl = Annotated[
    str | None,
    typer.Option("--robot", metavar="URL", help="A real robot instead of the embedded one."),
]
NoiseLevel = Annotated[
    str,
    typer.Option(
        "--noise",
        metavar="NAME|FILE",
        autocompletion=lambda: ["none", "lab", "datasheet", "hardware"],
        help="Noise model of the robot: none | lab | datasheet | hardware | FILE.yaml",
    ),
]
Seed = Annotated[int, typer.Option("--seed", metavar="N", help="Seed of everything random.")]
Rehearse = Annotated[
    bool | None,
    typer.Option(
        "--rehearse/--no-rehearse",
        help="Execute in simulation first (default: only for a real robot).",
    ),
]
OnFailure = Annotated[
    str,
    typer.Option("--on-failure", metavar="POLICY", help="When a leaf fails: stop | skip | replan."),
]
Out = Annotated[
    Path | None,
    typer.Option("--out", metavar="DIR", help="Run folder to make (default: runs/SCENE-TIME)."),
]
TwinFile = Annotated[
    Path | None,
    typer.Option(
        "--twin",
        metavar="FILE",
        help="Also write the twin there, with the includes, meshes and pictures that it needs.",
    ),
]
Fast = Annotated[
    bool,
    typer.Option(
        "--fast", help="No film and no replay of the twin; the measurement stays the same."
    ),
]
Yes = Annotated[bool, typer.Option("--yes", help="Do not ask before a real robot moves.")]
Live = Annotated[
    bool,
    typer.Option(
        "--live",
        help="Show the run in the browser, at the pace of a real arm; replay it afterwards.",
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
    """The moving arm, simulated or real."""

    PANEL: ClassVar[str] = "Robot"

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
    """Observers of a run beside the terminal."""

    PANEL: ClassVar[str] = "Watching"

    live: Live = False
    groot: Groot = False
    groot_port: GrootPort = 1667


@dataclass(frozen=True)
class ArmOptions:
    """The calibrated arm, simulated or real, and its scene; by default an own bench."""

    PANEL: ClassVar[str] = "Robot"

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
