"""Commands about scenes, plans and cameras; none moves anything."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.console import out
from palpate.cli.options import (
    ASKED,
    LOOK,
    MODEL,
    PLANNER,
    SCENE,
    AsJson,
    Fields,
    PlanFile,
    SceneArgument,
    SceneFile,
    one_scene,
    settings,
)
from palpate.runs.settings import settings_of

# Request to a model that detects a scene.
EVERYTHING_SEEN = "I want to simulate everything in this picture. What does each thing weigh?"


def scenarios(as_json: AsJson = False) -> None:
    """List the bundled scenarios."""
    from palpate.cli.show_scene import show_scenarios

    show_scenarios(as_json)


def init(
    folder: Annotated[Path, typer.Argument(help="Folder to write scene.xml and poses.yaml into.")],
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[OBJECT]...", help="Objects in it.")
    ] = None,
    *,
    surface: Annotated[str, typer.Option("--surface", help="Surface below them.")] = "table",
    given: Annotated[Fields, settings("images", "poses", "planner")],
    as_json: AsJson = False,
    model: Annotated[Fields, settings(MODEL)],
) -> None:
    """Write the files of a new scene, from names or from a picture that a model looks at."""
    from palpate.cli.show_scene import show_scaffold
    from palpate.runs.tools import new_scene, scene_from_picture

    if "images" not in given:
        show_scaffold(new_scene(folder, names or ["mug"], surface), as_json)
        return
    asked = settings_of(request=EVERYTHING_SEEN, **given, **model)
    show_scaffold(scene_from_picture(asked, folder), as_json)


def gap(
    scene: SceneFile, *, given: Annotated[Fields, settings(*SCENE)], as_json: AsJson = False
) -> None:
    """Show known and missing parameters of a scene."""
    from palpate.cli.show_scene import show_gap
    from palpate.runs.api import load_settings

    show_gap(load_settings(settings_of(scene=scene, **given)), as_json)


# Commands about plans. None moves a robot.


def plan(
    scene: SceneArgument = None,
    *,
    given: Annotated[Fields, settings(*ASKED, "world", *PLANNER)],
    out: Annotated[Path | None, typer.Option("--out", help="File to write the plan to.")] = None,
    as_json: AsJson = False,
    model: Annotated[Fields, settings(MODEL)],
) -> None:
    """Plan without execution: parameters, tree, explanation."""
    from palpate.cli.show_plan import show_plan
    from palpate.runs import pipeline
    from palpate.runs.api import plan_of

    asked = settings_of(**one_scene(scene, given), **model).check_values()
    planned = plan_of(pipeline.plan(asked, pipeline.load(asked)))
    show_plan(planned, as_json, out)
    raise typer.Exit(0 if planned.satisfied or planned.run_so_far.ready else 3)


def prompt(
    scene: SceneArgument = None,
    *,
    given: Annotated[Fields, settings(*ASKED, "remeasure", f"{MODEL}.prompt", f"{MODEL}.without")],
    as_json: AsJson = False,
) -> None:
    """Print the prompt for a model, to read it or to paste it into a chat."""
    from palpate.cli.show_plan import show_prompt

    show_prompt(settings_of(**one_scene(scene, given)), as_json)


def check(
    plan: PlanFile, *, given: Annotated[Fields, settings("scene", *SCENE)], as_json: AsJson = False
) -> None:
    """Check a plan against the vocabulary and a scene."""
    from palpate.cli.show_plan import show_findings
    from palpate.runs.tools import check_file

    findings = check_file(plan, settings_of(**given))
    show_findings(findings, as_json)
    raise typer.Exit(3 if findings else 0)


def vocabulary(
    as_json: Annotated[bool, typer.Option("--json", help="The JSON schema of a plan.")] = False,
    btcpp: Annotated[bool, typer.Option("--btcpp", help="BT.CPP 4 TreeNodesModel.")] = False,
) -> None:
    """Print the primitives and composites that plans are made of."""
    from palpate.cli.show_scene import show_vocabulary

    show_vocabulary(as_json, btcpp)


# Commands about cameras: a look at the workspace, and tags to print.

OF_LOOK = ("scene", *LOOK[1:], "poses", "root", "arm", "robot_config", "world", "seed")


def see(
    scene: SceneArgument = None,
    *,
    camera: Annotated[
        str,
        typer.Option(
            "--camera",
            metavar="SOURCE",
            help="Picture, video, a camera's number, realsense, or world:NAME of the simulated world.",
        ),
    ],
    given: Annotated[Fields, settings(*OF_LOOK)],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="poses.yaml to write.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Find objects in a camera's picture, by their tags or a pose estimator: poses with a covariance each."""
    import palpate as pp
    from palpate.cli.show_arms import show_seen
    from palpate.common.errors import InputError

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
    from palpate.runs.tools import tag_sheet

    pages = tag_sheet(output, numbers, size)
    out.print(
        f"{pages} page{'s' * (pages > 1)} written to {output}; print at 100 %, and measure the line of 100 mm",
        markup=False,
    )
