"""Commands about cameras: a look at the workspace, and tags to print."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.options import AsJson, Given, SceneArgument, one_scene, settings

OF_LOOK = (
    "scene",
    "intrinsics",
    "pose_estimator",
    "poses",
    "root",
    "arm",
    "robot_config",
    "world",
    "seed",
)


def see(
    scene: SceneArgument = None,
    *,
    camera: Annotated[
        str,
        typer.Option(
            "--camera",
            metavar="SOURCE",
            help="Picture or video, a camera's number, or world:NAME of the simulated world.",
        ),
    ],
    given: Annotated[Given, settings(*OF_LOOK)],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="poses.yaml to write.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Find objects in a camera's picture, by their tags or a pose estimator: poses with a covariance each."""
    import palpate as pp
    from palpate.cli.show.seeing import show_seen
    from palpate.errors import InputError

    asked = one_scene(scene, given)
    if "scene" not in asked:
        raise InputError("a look needs the scene whose objects it looks for: scene=D.xml")
    seen = pp.see(asked.pop("scene"), camera, **asked)
    show_seen(seen, None if output is None else seen.save(output), as_json)
    raise typer.Exit(1 if seen.unseen else 0)


def tags(
    *,
    numbers: Annotated[
        str, typer.Option("--numbers", metavar="A-B", help="Tags to print, e.g. 0-11 or 3,7,9.")
    ] = "0-11",
    size: Annotated[
        float, typer.Option("--size", metavar="M", help="Side of a tag's black square, m.")
    ] = 0.04,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="PDF to write.")
    ] = Path("tags.pdf"),
) -> None:
    """Write a sheet of tags to print, as a PDF at its exact size."""
    from palpate.cli.show.seeing import show_sheet
    from palpate.tools import tag_sheet

    show_sheet(output, tag_sheet(output, numbers, size))
