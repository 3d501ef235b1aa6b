"""What the stages of the pipeline are made of: whom the settings name as planner and as cell, and what is
asked of them.
"""

from __future__ import annotations

from contextlib import closing
from functools import partial
from typing import TYPE_CHECKING

from palpate.cells.cell import Cell
from palpate.cells.registry import drivers
from palpate.cells.simulated import SEEN_TOLERANCE, SIZE_TOLERANCE, simulated_cell
from palpate.cells.view import image_files
from palpate.errors import InputError, PlanRejected
from palpate.execution.recovery import OnFailure
from palpate.planning.check.check import Finding, check
from palpate.planning.plan import Plan
from palpate.planning.planner import Observant, Planner, PlannerSettings
from palpate.planning.registry import planners
from palpate.planning.symbolic.planner import requested
from palpate.robots.registry import load_description
from palpate.runs.run import Run
from palpate.scene.from_picture import DetectedScene, SceneBuilder
from palpate.scene.load import parse_scene
from palpate.scene.poses import Poses, read_poses
from palpate.scene.scene import Scene
from palpate.settings import Settings

if TYPE_CHECKING:
    from mujoco import MjSpec

    from palpate.execution.runner import Execution, Observer
    from palpate.robots.robot import Robot
    from palpate.trace.samples import Trace


def ask_planner(settings: Settings, scene: Scene | None, planner: Planner | None) -> Run:
    """The answer of `planner`, else of the one that the settings name, and what the check finds
    wrong with it.

    Raises:
        InputError: bad input. Unavailable: the provider.
    """
    poses = read_poses(settings.poses) if settings.poses else Poses()
    planner = planner or _planner(settings, poses)
    picture = _picture(planner, settings, scene, poses)
    answer = _answer(planner, settings, scene, picture)
    seen, conversation = None, None
    if isinstance(planner, Observant):
        seen, conversation = planner.seen, planner.conversation
    scene = scene or _scene_of(answer, seen)
    # A model's answers are checked one by one, until one passes; nobody else checks its own plan.
    checked = conversation is not None
    findings = () if checked else _findings(settings, answer, scene)
    return Run(settings, scene, answer, findings, conversation, seen, picture)


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


def replay(scene: Scene, plan: Plan, world: MjSpec) -> Trace:
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
    looks = scene is None or (isinstance(planner, Observant) and planner.looks)
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
