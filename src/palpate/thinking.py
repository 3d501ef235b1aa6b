"""From R, D and I to a checked plan: the planner is asked, shown the workspace, and its plan is
checked."""

from __future__ import annotations

from dataclasses import dataclass

from palpate.cells.view import image_files, workspace_png
from palpate.errors import InputError, PlanRejected
from palpate.planning.check.check import Finding, check
from palpate.planning.model.conversation import Conversation
from palpate.planning.model.planner import VlmPlanner
from palpate.planning.plan import Plan
from palpate.planning.planner import Planner, PlannerSettings
from palpate.planning.recorded import ReplayPlanner
from palpate.planning.registry import planners
from palpate.planning.symbolic.planner import requested
from palpate.scene.from_picture import DetectedScene, SceneBuilder
from palpate.scene.load import parse_scene
from palpate.scene.poses import Poses, read_poses
from palpate.scene.scene import Scene
from palpate.settings import Job


@dataclass(frozen=True, slots=True, eq=False)
class Thought:
    """A plan and how it came about.

    Attributes:
        scene: D, or what was made of the picture (nothing, where no plan came of it).
        plan: without a tree when it was rejected. findings: what the check says against it.
        conversation: with a model, if one was asked. seen: what it saw, where there was no D.
        picture: PNG of the simulated workspace that was shown, where no image was given.
    """

    scene: Scene
    plan: Plan
    findings: tuple[Finding, ...] = ()
    conversation: Conversation | None = None
    seen: DetectedScene | None = None
    picture: bytes | None = None


def think(job: Job, scene: Scene | None) -> Thought:
    """The planner's plan, checked.

    Raises:
        InputError: bad input. Unavailable: the provider.
    """
    poses = read_poses(job.poses) if job.poses else Poses()
    settings = PlannerSettings(job.remeasure, job.model_settings, SceneBuilder(poses))
    planner = planners().make(job.planner, settings)
    picture = _picture(planner, job, scene, poses)
    plan = _asked(planner, job, scene, picture)
    seen, conversation = None, None
    if isinstance(planner, VlmPlanner | ReplayPlanner):
        seen, conversation = planner.seen, planner.conversation
    scene = scene or _scene(plan, seen)
    return Thought(scene, plan, _findings(job, plan, scene), conversation, seen, picture)


def _picture(planner: Planner, job: Job, scene: Scene | None, poses: Poses) -> bytes | None:
    """The simulated workspace as PNG, where it is to be looked at and no image was given."""
    looks = scene is None or isinstance(planner, VlmPlanner)
    if job.images or not looks or "image" in job.model_settings.without:
        return None
    return workspace_png(job, scene, poses.camera)


def _asked(planner: Planner, job: Job, scene: Scene | None, picture: bytes | None) -> Plan:
    """The planner's answer; a rejection is a plan without a tree that says why."""
    with image_files(job, picture) as images:
        try:
            return planner.plan(job.request, scene, images)
        except PlanRejected as rejection:
            return Plan((), None, str(rejection), job.planner)


def _scene(plan: Plan, seen: DetectedScene | None) -> Scene:
    if seen is not None:
        return seen.scene()
    if plan.tree is not None:
        raise InputError(
            "the plan comes without the objects of its scene: give the MJCF with --scene D.xml"
        )
    return parse_scene("<mujoco><worldbody/></mujoco>")


def _findings(job: Job, plan: Plan, scene: Scene) -> tuple[Finding, ...]:
    """What the check says against a plan. What R asks is compared where somebody else than the
    grounding read it."""
    if plan.tree is None:
        return ()
    everything = job.planner == "exhaustive"
    compared = (
        job.request is not None
        and not everything
        and job.planner != "symbolic"
        and "text" not in job.model_settings.without
    )
    wanted = requested(job.request, scene, job.remeasure) if compared else None
    return check(plan, scene, remeasure=job.remeasure or everything, requested=wanted)
