"""Commands about scenes: bundled scenarios, a new scene, missing parameters."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.options import MODEL, SCENE, AsJson, Given, SceneFile, settings
from palpate.settings import settings_of

EVERYTHING_SEEN = "I want to simulate everything in this picture. What does each thing weigh?"
"""Request to a model that detects a scene."""


def scenarios(as_json: AsJson = False) -> None:
    """List the bundled scenarios."""
    from palpate.cli.show.catalogue import show_scenarios

    show_scenarios(as_json)


def init(
    folder: Annotated[Path, typer.Argument(help="Folder to write scene.xml and poses.yaml into.")],
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[OBJECT]...", help="Objects in it.")
    ] = None,
    *,
    surface: Annotated[str, typer.Option("--surface", help="Surface below them.")] = "table",
    given: Annotated[Given, settings("images", "poses", "planner")],
    as_json: AsJson = False,
    model: Annotated[Given, settings(MODEL)],
) -> None:
    """Write the files of a new scene, from names or from a picture that a model looks at."""
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
    """Show known and missing parameters of a scene."""
    from palpate.api.scenes import load_settings
    from palpate.cli.show.scene import show_gap

    show_gap(load_settings(settings_of(scene=scene, **given)), as_json)
