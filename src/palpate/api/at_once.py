"""All at once: from a scene, or from settings, to a finished run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Unpack

from palpate import pipeline
from palpate.api.given import Widths, is_text, names, path_of, paths_of, planner_name
from palpate.api.plans import Plan, RunOptions, plan_of
from palpate.api.runs import Run, run_of
from palpate.api.scenes import Scene, load
from palpate.callbacks import SILENT, RunCallbacks, quiet
from palpate.planning.model.settings import ModelSettings
from palpate.planning.planner import Planner
from palpate.quantities.within import Within
from palpate.robots.registry import DEFAULT
from palpate.settings import Settings


def run(
    scene: str | Path | Scene | None = None,
    request: str | None = None,
    *,
    poses: str | Path | None = None,
    arm: str | Path = DEFAULT,
    cautious: bool = False,
    robot_config: str | Path | None = None,
    root: str | Path | None = None,
    robot_body: str | Sequence[str] = (),
    planner: str | Planner = "symbolic",
    images: Sequence[str | Path] = (),
    remeasure: bool = False,
    within: Widths | None = None,
    model_settings: ModelSettings | None = None,
    **options: Unpack[RunOptions],
) -> Run:
    """Load, plan, execute, estimate and build the twin, all in memory.

    Args:
        scene: MJCF as `load` takes it, or a scene; None lets a model look at a picture instead.
        request: what you want to simulate, in your words; None asks for all that is missing.
        poses: as `load`.
        arm: as `load`.
        cautious: as `load`.
        robot_config: as `load`.
        root: as `load`.
        robot_body: as `load`.
        planner: as `Scene.plan`.
        images: as `Scene.plan`.
        remeasure: as `Scene.plan`.
        within: as `Scene.plan`.
        model_settings: as `Scene.plan`.
        options: as `Plan.run`: `seed`, `noise`, `world`, `robot`, `cell`, `out`, `progress`, …

    Returns:
        The finished run, in memory; with `out=` also in a folder.

    Raises:
        InputError: bad input.
        Unavailable: planner or robot out of reach.
        ExecutionAborted: a real robot was not allowed to move.
    """
    asked = Settings(
        request=request,
        poses=path_of(poses),
        images=paths_of(images),
        planner=planner_name(planner),
        arm=str(arm),
        cautious=cautious,
        robot_config=path_of(robot_config),
        root=path_of(root),
        robot_body=names(robot_body),
        remeasure=remeasure,
        within=Within.read(within or {}),
        model_settings=model_settings or ModelSettings(),
    )
    # How it is to run is looked at before anybody plans: a model's answer costs money.
    planned = replace(asked, **_stated(options)).checked(at_hand=scene is not None)
    if options.get("cell") is None:
        pipeline.preflight(planned)
    found = scene
    if isinstance(found, str | Path):
        found = load(found, poses, arm, cautious, robot_config, root, robot_body)
    if found is not None:
        planned = found.settings(planned)
    options.get("progress", quiet)("planning")
    return plan_of(planned, found, planner).run(**options)


def plan_settings(settings: Settings) -> Plan:
    """The plan that settings describe, as the command line has them.

    Raises:
        InputError: bad input.
        Unavailable: the provider.
    """
    settings = settings.checked()
    return plan_of(settings, pipeline.load(settings), settings.planner)


def run_settings(settings: Settings, callbacks: RunCallbacks = SILENT) -> Run:
    """The run that settings describe, as the command line has them, into a run folder.

    Raises:
        InputError: bad input; nothing is planned then.
        Unavailable: planner or robot out of reach.
        ExecutionAborted: a real robot was not allowed to move.
    """
    return run_of(pipeline.run(settings, callbacks))


def _stated(options: RunOptions) -> dict[str, Any]:
    """Options that are fields of the settings; a world given as an object has no file."""
    names = ("robot", "noise", "seed", "on_failure", "rehearse", "fast")
    stated: dict[str, Any] = {name: options.get(name) for name in names if name in options}
    folder, world = options.get("out"), options.get("world")
    if folder is not None:
        stated["out"] = Path(folder)
    if isinstance(world, str | Path) and not is_text(world):
        stated["world"] = Path(world)
    return stated
