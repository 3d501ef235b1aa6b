"""Commands about scenes: those that are bundled, one to begin with, what one does not know."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.options import MODEL, SCENE, AsJson, Given, SceneFile, settings
from palpate.settings import settings_of

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
    given: Annotated[Given, settings("images", "poses", "planner")],
    as_json: AsJson = False,
    model: Annotated[Given, settings(MODEL)],
) -> None:
    """Begin a scene of your own: commented files, from names, or from a picture that a model looks at."""
    from palpate.cli.show.scene import show_scaffold
    from palpate.tools import new_scene, scene_from_picture

    if "images" not in given:
        show_scaffold(new_scene(folder, names or ["mug"], surface), as_json)
        return
    asked = settings_of(request=EVERYTHING_SEEN, **given, **model)
    show_scaffold(scene_from_picture(asked, folder), as_json)


def gap(
    scene: SceneFile, *, given: Annotated[Given, settings(*SCENE)], as_json: AsJson = False
) -> None:
    """Show what a scene states and what is missing."""
    from palpate.api import load_settings
    from palpate.cli.show.scene import show_gap

    show_gap(load_settings(settings_of(scene=scene, **given)), as_json)
