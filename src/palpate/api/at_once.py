"""Run of all stages in one call, from a scene or from settings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from functools import partial
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

from palpate import pipeline
from palpate.api.given import Widths, is_file, known_keywords, planner_name
from palpate.api.plans import Plan, hidden_world, plan_of
from palpate.api.runs import Run, run_of
from palpate.api.scenes import Scene, load
from palpate.callbacks import SILENT, Confirm, Progress, RunCallbacks, quiet
from palpate.parameter import Parameter
from palpate.planning.planner import Planner
from palpate.settings import Settings

if TYPE_CHECKING:
    from palpate.cells.cell import Cell
    from palpate.execution.recovery import OnFailure
    from palpate.execution.runner import Observer
    from palpate.planning.model.settings import ModelSettings
    from palpate.scene.scene import Scene as InnerScene


class Options(TypedDict, total=False):
    """The arguments of `load`, `Scene.plan` and `Plan.run` together."""

    poses: str | Path | None
    camera: str | int | None
    intrinsics: str | Path | None
    pose_estimator: str | None
    arm: str | Path
    cautious: bool
    robot_config: str | Path | None
    root: str | Path | None
    robot_body: str | Sequence[str]
    measure: str | Parameter | Sequence[str | Parameter] | None
    images: Sequence[str | Path]
    remeasure: bool
    within: Widths | None
    model_settings: ModelSettings | None
    cell: Cell | None
    world: str | Path | InnerScene | None
    robot: str | None
    noise: str
    seed: int
    on_failure: OnFailure
    rehearse: bool | None
    fast: bool
    confirm: Confirm
    observer: Observer | None
    progress: Progress
    out: str | Path | None


@partial(known_keywords, more=Options.__annotations__)
def run(
    scene: str | Path | Scene | None = None,
    request: str | None = None,
    *,
    planner: str | Planner = "symbolic",
    **options: Unpack[Options],
) -> Run:
    """Load, plan, execute, estimate and build the twin, all in memory.

    Args:
        scene: MJCF as `load` takes it, or a scene; None lets a model look at a picture instead.
        request: what you want to simulate, in your words; None asks for all that is missing.
        planner: as `Scene.plan`.
        options: as `load`: `poses`, `arm`, `cautious`, `robot_config`, `root`, `robot_body`; as
            `Scene.plan`: `measure`, `images`, `remeasure`, `within`, `model_settings`; as `Plan.run`: `seed`,
            `noise`, `world`, `robot`, `cell`, `on_failure`, `rehearse`, `fast`, `out`, `confirm`,
            `observer`, `progress`; and `camera`, `intrinsics`, `pose_estimator`, as `see`: a look first, whose poses
            take the place of the scene's (`run.scene` has them, also as `confirm` is asked).

    Returns:
        The finished run, in memory; with `out=` also in a folder.

    Raises:
        InputError: bad input.
        Unavailable: planner or robot out of reach.
        ExecutionAborted: a real robot was not allowed to move.
    """
    of_load, of_run = _those_of(load, options), _those_of(Plan.run, options)
    found = load(scene, **of_load) if isinstance(scene, str | Path) else scene
    names = [field.name for field in fields(Settings)]
    stated: dict[str, Any] = {n: v for n, v in options.items() if n in names and v is not None}
    if found is not None:
        stated = {name: value for name, value in stated.items() if name not in of_load}
    if not is_file(stated.get("world")):
        stated.pop("world", None)  # MJCF text, or a scene: `Plan.run` reads it
    given = Settings() if found is None else found.given
    asked = given.having(request=request, planner=planner_name(planner), **stated)
    # Everything is checked before anybody plans: a model's answer costs money.
    asked = asked.checked(at_hand=found is not None)
    if options.get("cell") is None:
        pipeline.preflight(asked)
    progress = options.get("progress", quiet)
    # Read once: the camera may look at the world in which the robot then moves.
    of_run["world"] = hidden_world(options.get("world"), asked)
    placed, seen = pipeline.look(asked, found, RunCallbacks(progress=progress), of_run["world"])
    progress("planning")
    return plan_of(asked, placed, planner, seen).run(**of_run)


def _those_of(verb: Callable[..., object], options: Mapping[str, Any]) -> dict[str, Any]:
    """The options that are arguments of a verb."""
    return {name: options[name] for name in signature(verb).parameters if name in options}


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
