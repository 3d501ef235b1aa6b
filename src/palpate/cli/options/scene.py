"""Options: request, scene and arm."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import typer

from palpate.errors import InputError

if TYPE_CHECKING:
    from palpate.settings import Settings


Request = Annotated[
    str | None,
    typer.Option(
        "-r", "--request", metavar="TEXT", help="What you want to simulate, in your words."
    ),
]
SceneFile = Annotated[
    Path | None,
    typer.Option("--scene", metavar="FILE", help="Your MJCF; what is absent or '?' is unknown."),
]
Images = Annotated[
    list[Path] | None,
    typer.Option("--image", metavar="FILE", help="Picture of the workspace; may be repeated."),
]
Root = Annotated[
    Path | None,
    typer.Option(
        "--root",
        metavar="DIR",
        help="Folder of the scene's files (default: the nearest that holds them all).",
    ),
]
RobotBody = Annotated[
    list[str] | None,
    typer.Option(
        "--robot-body",
        metavar="NAME",
        help="Root body of the scene's own robot, which the arm replaces, or 'none'; may be repeated "
        "(default: found by its actuators or its hand).",
    ),
]
Poses = Annotated[
    Path | None,
    typer.Option("--poses", metavar="FILE", help="poses.yaml: objects, places, offsets."),
]
Arm = Annotated[
    str,
    typer.Option(
        "--arm", metavar="NAME|PATH/", help="Name of an arm, or folder of its description."
    ),
]
DEFAULT_ARM = "fr3"
"""`robots.registry.DEFAULT`, written here so that a command's help need not load the robots."""
World = Annotated[
    Path | None,
    typer.Option("--world", metavar="FILE", help="MJCF of the embedded robot's hidden world."),
]


@dataclass(frozen=True)
class SceneOptions:
    """Request, scene and arm."""

    PANEL: ClassVar[str] = "Scene"

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
    """Scene and arm of a plan that exists already."""

    PANEL: ClassVar[str] = "Scene"

    scene: SceneFile = None
    poses: Poses = None
    root: Root = None
    robot_body: RobotBody = None
    arm: Arm = DEFAULT_ARM
