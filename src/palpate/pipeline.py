"""The whole story on one page: a sentence, or an incomplete scene, becomes a digital twin.

request + scene + pictures ─► parameters ─► plan ─► (check) ─► tree ─ticks─► trace ─► estimates
─► twin + report
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.cells.cell import Cell
from palpate.cells.registry import drivers
from palpate.cells.simulated import SEEN_TOLERANCE, SIZE_TOLERANCE, simulated_cell
from palpate.cells.view import image_files
from palpate.errors import ExecutionAborted, InputError, PlanRejected
from palpate.execution.recovery import OnFailure
from palpate.planning.check.check import Finding, check
from palpate.planning.model.planner import VlmPlanner
from palpate.planning.plan import Plan
from palpate.planning.planner import Planner, PlannerSettings
from palpate.planning.recorded import ReplayPlanner
from palpate.planning.registry import planners
from palpate.planning.symbolic.planner import requested
from palpate.quantities.estimators import estimate_all
from palpate.robots.registry import load_description
from palpate.runs.folder import default_folder, new_folder, read_json, write_json
from palpate.runs.run import Ending, Run
from palpate.scene.camera import load_image
from palpate.scene.from_picture import DetectedScene, SceneBuilder
from palpate.scene.load import load_scene, parse_scene
from palpate.scene.poses import Poses, read_poses
from palpate.scene.scene import Scene
from palpate.settings import Settings, request_json, settings_from
from palpate.twin.twin import build_twin as build

if TYPE_CHECKING:
    from mujoco import MjSpec

    from palpate.execution.runner import Execution, Observer
    from palpate.robots.robot import Robot
    from palpate.trace.samples import Trace

Progress = Callable[[str], None]
"""Told which stage begins."""
Confirm = Callable[[Run], bool]
"""Shown a plan before a real robot moves; whether it may."""


def quiet(_: str) -> None:
    """Tell nobody which stage begins."""


def unasked(_: Run) -> bool:
    """Let the robot move without asking anybody."""
    return True


def run(
    settings: Settings,
    observer: Observer | None = None,
    progress: Progress = quiet,
    may_move: Confirm = unasked,
) -> Run:
    """From settings to a finished run folder.

    Raises:
        InputError: bad input. Unavailable: planner or robot out of reach. ExecutionAborted: not
            confirmed.
    """
    settings = settings.checked()
    scene = load(settings)
    progress("planning")
    made = rehearse(plan(settings, scene), progress)
    confirm(made, may_move)
    made = build_twin(measure(made, observer, progress), progress)
    progress("writing the report")
    return save(made)


def load(settings: Settings) -> Scene | None:
    """D and the poses that came with it, or None without D; the pictures are checked on the way."""
    for image in settings.images:
        load_image(image)
    if settings.scene is None:
        return None
    return load_scene(settings.scene, settings.poses, load_description(settings.arm))


def plan(settings: Settings, scene: Scene | None, planner: Planner | None = None) -> Run:
    """A plan and what the check finds wrong with it; a plan without a tree is an honest rejection.

    `planner` is asked, else the one that the settings name. Without D the scene is made of what a
    model saw in the picture.

    Raises:
        InputError: bad input. Unavailable: the provider.
    """
    poses = read_poses(settings.poses) if settings.poses else Poses()
    planner = planner or _planner(settings, poses)
    picture = _picture(planner, settings, scene, poses)
    answer = _answer(planner, settings, scene, picture)
    seen, conversation = None, None
    if isinstance(planner, VlmPlanner | ReplayPlanner):
        seen, conversation = planner.seen, planner.conversation
    scene = scene or _scene_of(answer, seen)
    # A model's answers are checked one by one, until one passes; nobody else checks its own plan.
    checked = conversation is not None
    findings = () if checked else _findings(settings, answer, scene)
    return Run(settings, scene, answer, findings, conversation, seen, picture)


def rehearse(made: Run, progress: Progress = quiet) -> Run:
    """A rehearsal where the settings want one; a failure in it is a finding, and a plan with
    findings is not executed."""
    wanted = made.settings.rehearse
    if wanted is None:
        wanted = made.settings.robot is not None
    if not wanted or not made.ready:
        return made
    from palpate.execution.rehearsal import rehearse as rehearse_plan

    progress("rehearsing in simulation")
    rehearsal = rehearse_plan(made.plan, made.scene)
    progress(f"rehearsal: {rehearsal}")
    if rehearsal.failure is None:
        return replace(made, rehearsal=rehearsal)
    failed = Finding.of("tree", "rehearsal", f"in simulation the plan fails: {rehearsal.failure}")
    return replace(made, rehearsal=rehearsal, findings=(failed,))


def confirm(made: Run, may_move: Confirm, cell: Cell | None = None) -> None:
    """Ask before a real robot moves, that of `cell` or of the settings; a simulation needs no
    confirmation.

    Raises:
        ExecutionAborted: the plan was not confirmed.
    """
    real = made.settings.robot is not None or (cell is not None and not cell.simulated)
    if real and made.ready and not may_move(made):
        raise ExecutionAborted("the plan was not confirmed; nothing has moved")


def measure(
    made: Run,
    observer: Observer | None = None,
    progress: Progress = quiet,
    cell: Cell | None = None,
) -> Run:
    """From a checked plan to estimates, in `cell`, else in the one that the settings name. A plan
    with findings, or without a tree, is rejected: nothing moves."""
    if not made.ready:
        return made
    cell = cell or cell_for(made.settings, made.scene, seen=made.seen is not None)
    return estimate(execute(made, cell, observer, progress), cell, progress)


def execute(
    made: Run, cell: Cell, observer: Observer | None = None, progress: Progress = quiet
) -> Run:
    """From a plan to a trace."""
    robot = cell.robot()
    progress(f"executing on the {'simulated' if cell.simulated else 'real'} robot")
    done = perform(made.plan, made.scene, robot, observer, made.settings.on_failure)
    return replace(
        made,
        world=cell.description,
        simulated=cell.simulated,
        execution=Ending.of(done),
        final_state=done.final_state,
        recorded=done.trace,
        footage=cell.footage(),
    )


def estimate(made: Run, cell: Cell, progress: Progress = quiet) -> Run:
    """From a trace to estimates; what is true is asked when they are made, never before."""
    assert made.trace is not None
    progress("estimating")
    estimates = estimate_all(made.plan.parameters, made.trace, made.scene.bodies)
    known = {e.parameter: cell.truth(e.parameter) for e in estimates}
    truth = {parameter: values for parameter, values in known.items() if values is not None}
    return replace(made, estimates=estimates, truth=truth)


def build_twin(made: Run, progress: Progress = quiet) -> Run:
    """From estimates to a twin of the scene as it was believed in the end."""
    if made.final_state is None or made.trace is None:
        return made
    progress("building the twin, and touching it in simulation")
    replay = partial(_replay, made.scene, made.plan)
    scene = made.final_state.scene if made.seen else made.scene
    twin = build(scene, made.estimates, made.trace, replay)
    return replace(made, scene=scene, twin=twin)


def save(made: Run, folder: Path | None = None) -> Run:
    """The run folder: request, plan, tree, trace, result, twin, report and images.

    `folder` must not exist; without one it is the settings' own, else a new one under `runs`.

    Raises:
        InputError: the folder exists or cannot be made.
    """
    from palpate.report.contents import report_data, take_pictures, write_images
    from palpate.report.page import write_report
    from palpate.runs.files import write_files

    folder = folder or made.settings.out or default_folder(_name(made.settings))
    with new_folder(folder) as scratch:
        write_json(scratch / "request.json", request_json(made.settings))
        write_files(made, scratch, folder)
        pictures = take_pictures(made)
        write_images(pictures, scratch / "images")
        write_report(scratch / "report.html", report_data(made, pictures, scratch))
    return replace(made, folder=folder)


def reopen(folder: Path) -> Run:
    """The run that `save` wrote into `folder`; its trace is read when first asked for.

    Raises:
        InputError: there is no such folder, or it is not a run's.
    """
    from palpate.runs.read import read_run

    settings = settings_from(read_json(folder / "request.json"))
    return read_run(folder, settings)


def cell_for(settings: Settings, scene: Scene | None, seen: bool = False) -> Cell:
    """The cell that the settings name; `seen`: the scene was made of a picture.

    Raises:
        InputError: world and scene do not match. Unavailable: no driver for the robot.
    """
    if settings.robot is not None:
        return drivers().connect(settings.robot, scene)
    tolerance = SEEN_TOLERANCE if seen else SIZE_TOLERANCE
    return simulated_cell(
        scene,
        settings.world,
        noise=settings.noise,
        seed=settings.seed,
        tolerance=tolerance,
        arm=load_description(settings.arm),
    )


def picture_of(settings: Settings, scene: Scene | None, poses: Poses) -> bytes | None:
    """The workspace as PNG, seen by the camera of `poses` if it has one; None where there is nothing
    to look at or no way to look."""
    if scene is None and settings.world is None and settings.robot is None:
        return None
    return cell_for(settings, scene).picture(poses.camera)


def perform(
    plan: Plan,
    scene: Scene,
    robot: Robot,
    observer: Observer | None = None,
    on_failure: OnFailure = "stop",
) -> Execution:
    """Run the tree on the robot, and go on after a failure as far as the policy allows; the robot
    is let go in any case."""
    from palpate.execution.recovery import recover
    from palpate.execution.runner import run as run_tree

    attempt = partial(run_tree, observer=observer)
    with closing(robot):
        return recover(attempt(plan, scene, robot), plan, scene, robot, on_failure, attempt)


def _replay(scene: Scene, plan: Plan, world: MjSpec) -> Trace:
    """What a perfect robot feels when the plan is executed in `world`."""
    from palpate.robots.simulated.robot import MujocoRobot

    return perform(plan, scene, MujocoRobot(world, scene.pose_world_base, scene.arm)).trace


def _planner(settings: Settings, poses: Poses) -> Planner:
    builder = SceneBuilder(poses, load_description(settings.arm))
    told = PlannerSettings(settings.remeasure, settings.model_settings, builder)
    return planners().make(settings.planner, told)


def _picture(
    planner: Planner, settings: Settings, scene: Scene | None, poses: Poses
) -> bytes | None:
    """The workspace as PNG, where it is to be looked at and no image was given."""
    looks = scene is None or isinstance(planner, VlmPlanner)
    if settings.images or not looks or "image" in settings.model_settings.without:
        return None
    return picture_of(settings, scene, poses)


def _answer(
    planner: Planner, settings: Settings, scene: Scene | None, picture: bytes | None
) -> Plan:
    """The planner's answer; a rejection is a plan without a tree that says why."""
    with image_files(settings.images, picture) as images:
        try:
            return planner.plan(settings.request, scene, images)
        except PlanRejected as rejection:
            return Plan((), None, str(rejection), settings.planner)


def _scene_of(answer: Plan, seen: DetectedScene | None) -> Scene:
    """What a model saw; a rejection without D is about an empty scene."""
    if seen is not None:
        return seen.scene()
    if answer.tree is not None:
        raise InputError(
            "the plan comes without the objects of its scene: give the MJCF with scene=D.xml"
        )
    return parse_scene("<mujoco><worldbody/></mujoco>")


def _findings(settings: Settings, answer: Plan, scene: Scene) -> tuple[Finding, ...]:
    """What the check says against a plan. What R asks is compared where somebody else than the
    grounding read it."""
    if answer.tree is None:
        return ()
    everything = settings.planner == "exhaustive"
    compared = (
        settings.request is not None
        and not everything
        and settings.planner != "symbolic"
        and "text" not in settings.model_settings.without
    )
    wanted = requested(settings.request, scene, settings.remeasure) if compared else None
    remeasure = settings.remeasure or everything
    return check(answer, scene, remeasure=remeasure, requested=wanted)


def _name(settings: Settings) -> str:
    """What a run folder is named after."""
    return settings.scene.resolve().parent.name if settings.scene else ""
