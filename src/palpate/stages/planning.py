"""The second stage: a planner is asked, and its plan is checked."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from palpate.errors import InputError, PlanRejected
from palpate.geometry.pose import Pose
from palpate.planning.check.check import Finding, check
from palpate.planning.plan import Plan
from palpate.planning.planner import Observant, Planner, PlannerSettings
from palpate.planning.registry import planners
from palpate.planning.symbolic.planner import requested
from palpate.runs.run import Run
from palpate.scene.load import parse_scene
from palpate.scene.pictured.detected import DetectedScene, SceneBuilder
from palpate.scene.poses import Poses, read_poses, seen_by
from palpate.scene.scene import Scene
from palpate.settings import Settings
from palpate.stages.workplace import pictures_of
from palpate.vocabulary.admissible.reach import require_room


def plan(settings: Settings, scene: Scene | None, planner: Planner | None = None) -> Run:
    """A plan and what the check finds wrong with it; a plan without a tree is an honest rejection.

    `planner` is asked, else the one that the settings name. Without D the scene is made of what a
    model saw in the picture.

    Raises:
        InputError: bad input, or a scene without room for the arm.
        Unavailable: the provider.
    """
    if scene is not None:
        settings.within.check(scene.bodies)
        require_room(scene)
    poses = _poses(settings, scene)
    planner = planner or _planner(settings, poses)
    pictures = _pictures(planner, settings, scene, poses)
    answer = _answer(planner, settings, scene, pictures)
    seen, conversation = None, None
    if isinstance(planner, Observant):
        seen, conversation = planner.seen, planner.conversation
    scene = scene or _scene_of(answer, seen)
    answer = _read_otherwise(settings, answer, scene)
    # A model's answers are checked one by one, until one passes; nobody else checks its own plan.
    findings = _findings(settings, answer, scene) if conversation is None else ()
    return Run(settings, scene, answer, findings, conversation, seen, next(iter(pictures), None))


def _poses(settings: Settings, scene: Scene | None) -> Poses:
    """Poses of the settings' file, transformed for the arm from which they were seen."""
    poses = read_poses(settings.poses) if settings.poses else Poses()
    base = Pose.of((0.0, 0.0, 0.0)) if scene is None else scene.pose_world_base
    return seen_by(poses, settings.described_arm(), base)


def _planner(settings: Settings, poses: Poses) -> Planner:
    """The one that the settings name."""
    builder = SceneBuilder(poses, settings.described_arm())
    told = PlannerSettings(settings.remeasure, settings.model_settings, builder, settings.within)
    return planners().make(settings.planner, told)


def _pictures(
    planner: Planner, settings: Settings, scene: Scene | None, poses: Poses
) -> tuple[bytes, ...]:
    """The workspace as PNGs, where it is to be looked at and no image was given."""
    looks = scene is None or (isinstance(planner, Observant) and planner.looks)
    if settings.images or not looks or "image" in settings.model_settings.without:
        return ()
    return pictures_of(settings, scene, poses)


def _answer(
    planner: Planner, settings: Settings, scene: Scene | None, pictures: tuple[bytes, ...]
) -> Plan:
    """The planner's answer; a rejection is a plan without a tree that says why."""
    with _image_files(settings.images, pictures) as images:
        try:
            return planner.plan(settings.request, scene, images)
        except PlanRejected as rejection:
            return Plan((), None, str(rejection), settings.planner)


@contextmanager
def _image_files(given: tuple[Path, ...], taken: Sequence[bytes]) -> Generator[tuple[Path, ...]]:
    """The images that were given, or the pictures that were taken of the workspace as files while
    the block runs."""
    if given or not taken:
        yield given
        return
    with TemporaryDirectory() as folder:
        paths: list[Path] = []
        for name, content in zip(("workspace.png", "closer.png"), taken, strict=False):
            paths.append(Path(folder) / name)
            paths[-1].write_bytes(content)
        yield tuple(paths)


def _scene_of(answer: Plan, seen: DetectedScene | None) -> Scene:
    """Scene that a model saw; a rejection without D is about an empty scene."""
    if seen is not None:
        return seen.scene()
    if answer.tree is not None:
        raise InputError(
            "the plan comes without the objects of its scene: give the MJCF with scene=D.xml"
        )
    return parse_scene("<mujoco><worldbody/></mujoco>")


def _findings(settings: Settings, answer: Plan, scene: Scene) -> tuple[Finding, ...]:
    """Findings of the check on a plan."""
    if answer.tree is None:
        return ()
    remeasure = settings.remeasure or settings.planner == "exhaustive"
    return check(answer, scene, remeasure=remeasure)


def _read_otherwise(settings: Settings, answer: Plan, scene: Scene) -> Plan:
    """The plan with a note where the words of the request are read as asking for something else
    than it measures. What they mean is for whoever wrote the plan to say."""
    own = settings.planner in ("symbolic", "exhaustive")
    if own or settings.request is None or "text" in settings.model_settings.without:
        return answer
    wanted = requested(settings.request, scene, settings.remeasure)
    if answer.tree is None or wanted is None or set(wanted) == set(answer.parameters):
        return answer
    asked = ", ".join(str(parameter) for parameter in wanted)
    note = (
        f"By its words the request asks for {asked}; the plan measures what its author took it for."
    )
    return replace(answer, notes=(*answer.notes, note))
