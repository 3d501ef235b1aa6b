"""Commands about scenes: those that are bundled, one to begin with, what one does not know."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.options.model import ModelOptions, Planner
from palpate.cli.options.results import AsJson
from palpate.cli.options.scene import DEFAULT_ARM, Arm, Images, Poses, RobotBody, Root

EVERYTHING_SEEN = "I want to simulate everything in this picture. What does each thing weigh?"
"""Request to a model that is to detect a scene."""


def scenarios(as_json: AsJson = False) -> None:
    """List the bundled scenarios."""
    from palpate.cli.show.catalogue import show_scenarios

    show_scenarios(as_json)


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
