"""Stages before any motion: load the scene, plan, check, rehearse in simulation, confirm."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from palpate.common.errors import ExecutionAborted, InputError
from palpate.common.parameter import Parameter, PlanRejected
from palpate.common.pose import Pose
from palpate.execution.cell import Cell
from palpate.execution.cell_drivers import drivers
from palpate.planning.check.check import check
from palpate.planning.check.finding import Finding
from palpate.planning.plan import Plan, UnmeasuredParameters
from palpate.planning.planner import Observant, Planner, PlannerSettings, in_words, named_parameters
from palpate.planning.registry import OWN, planners
from palpate.planning.request.grounding import stated_widths
from palpate.planning.symbolic.planner import requested_parameters, split_known
from palpate.primitives.rules.collision_geometry import require_room
from palpate.runs.callbacks import SILENT, RunCallbacks
from palpate.runs.run import Run
from palpate.runs.settings import Settings
from palpate.runs.workplace import pictures_of
from palpate.scene.camera import load_image
from palpate.scene.load import parse_scene
from palpate.scene.picture_scene import DetectedScene, SceneBuilder
from palpate.scene.poses import Poses, add_arm_camera, read_poses
from palpate.scene.scene import Scene

if TYPE_CHECKING:
    from palpate.execution.rehearsal import Rehearsal


def preflight(settings: Settings) -> None:
    """Require that the robot of the settings answers, before a plan is made for it."""
    if settings.robot is not None:
        drivers().connect(settings.robot, None)


def load(settings: Settings) -> Scene | None:
    """Load the scene with its poses; None if the settings name none."""
    if settings.scene is None:
        return None
    return settings.read_scene(settings.described_arm())


def plan(settings: Settings, scene: Scene | None, planner: Planner | None = None) -> Run:
    """Ask the planner (by default the one that the settings name) and check its answer.

    A plan without a tree is a rejection. Without a scene file, the scene is built from the objects
    that a model detected in the picture.
    """
    for image in settings.images:
        load_image(image)
    if scene is not None:
        if settings.request is not None and not settings.within:
            settings = settings.having(within=stated_widths(settings.request, scene))
        settings.within.check(scene.bodies)
        require_room(scene)

    # Resolve the parameters to measure, and add them to the request.
    measure = _resolve_measure(settings, scene)
    request = settings.request
    if measure is not None:
        request = " ".join(filter(None, (request, in_words(measure))))

    # Transform the poses from the arm that saw them to the arm that will move.
    base = Pose.of((0.0, 0.0, 0.0)) if scene is None else scene.pose_world_base
    arm = settings.described_arm() if scene is None else scene.arm
    poses = add_arm_camera(read_poses(settings.poses) if settings.poses else Poses(), arm, base)
    if planner is None:
        builder, model = SceneBuilder(poses, arm), settings.model_settings
        asked = PlannerSettings(
            settings.remeasure,
            model,
            builder,
            settings.within,
            measure,
            rehearse=None if settings.rehearse is False else finding_of_rehearsal,
        )
        planner = planners().make(settings.planner, asked)

    # Ask the planner; a rejection becomes a plan without a tree.
    pictures, blind = _pictures(planner, settings, scene, poses)
    with _image_files(settings.images, pictures) as images:
        try:
            answer = planner.plan(request, scene, images)
        except PlanRejected as rejection:
            proposal, unused = rejection.proposal, rejection.not_used
            answer = Plan(
                (), None, str(rejection), settings.planner, proposal=proposal, not_used=unused
            )
    # Complete the answer: the detected scene, notes, and parameters that the plan omits.
    seen, conversation = None, None
    if isinstance(planner, Observant):
        seen, conversation = planner.seen, planner.conversation
    scene = scene or _detected_scene(answer, seen)
    answer = _add_reading_note(settings, answer, scene)
    if measure is not None:
        answer = _add_left_out(answer, split_known(measure, scene, settings.remeasure)[1])
    unused = settings.within.unused(answer.parameters) if answer.tree is not None else ""
    answer = replace(answer, notes=(*answer.notes, *blind, *filter(None, [unused])))

    findings: tuple[Finding, ...] = ()
    # Answers of a model were checked during its conversation. Check those of other planners here.
    if conversation is None and answer.tree is not None:
        remeasure = settings.remeasure or settings.planner == "exhaustive"
        wanted = None if measure is None else requested_parameters(None, scene, remeasure, measure)
        findings = check(answer, scene, remeasure=remeasure, requested=wanted)
    return Run(
        settings,
        scene,
        answer,
        findings,
        conversation=conversation,
        seen=seen,
        picture=next(iter(pictures), None),
    )


def finding_of_rehearsal(plan: Plan, scene: Scene) -> Finding | None:
    """Rehearse a plan and return its finding, for a planner that corrects its plan."""
    from palpate.execution.rehearsal import rehearse as rehearse_plan

    return rehearse_plan(plan, scene).finding


def rehearse(run: Run, callbacks: RunCallbacks = SILENT, cell: Cell | None = None) -> Run:
    """Execute the plan in simulation before any motion.

    Plans of a model, a file or a user's own planner are always rehearsed. palpate's own plans are
    rehearsed before a real robot moves. Harm and failures become findings, and a plan with findings
    is not executed. If the run folder of the plan keeps its rehearsal, the embedded arm needs no
    other one, unless `rehearse` is True.
    Raises InputError: a real robot moves, that of `cell` or of the settings, and `rehearse` is False.
    """
    # Decide: a real arm always, otherwise by the setting or the planner.
    real, wanted = _is_real(run, cell), run.settings.rehearse
    if real and wanted is False:
        raise InputError(
            "rehearse=False (--no-rehearse) is for the embedded arm, not for a real one"
        )
    if wanted is None:
        wanted = real or run.settings.planner not in OWN
    if not run.ready or not wanted:
        return run
    from palpate.execution.rehearsal import rehearse as rehearse_plan

    # A person may read the plan during the rehearsal.
    if real:
        callbacks.planned(run)
    rehearsal = None if real or run.settings.rehearse else _rehearsed_before(run)
    before = "" if rehearsal is None else " of the run that the plan comes from"
    if rehearsal is None:
        callbacks.progress("rehearsing in simulation")
        rehearsal = rehearse_plan(run.plan, run.scene)
    callbacks.progress(f"rehearsal{before}: {rehearsal}")
    failed = rehearsal.finding
    return replace(run, rehearsal=rehearsal, findings=() if failed is None else (failed,))


def _rehearsed_before(run: Run) -> Rehearsal | None:
    """Read the rehearsal in the run folder of a replayed plan; None without one."""
    # Only a replayed plan has such a folder.
    name, _, path = run.settings.planner.partition(":")
    if name != "replay":
        return None
    from palpate.execution.rehearsal import kept_rehearsal

    folder = Path(path) if Path(path).is_dir() else Path(path).parent
    return kept_rehearsal(folder, run.plan, run.scene)


def _is_real(run: Run, cell: Cell | None) -> bool:
    """True if a real robot will move: that of `cell` or of the settings."""
    return run.settings.robot is not None or (cell is not None and not cell.simulated)


def confirm(run: Run, callbacks: RunCallbacks = SILENT, cell: Cell | None = None) -> None:
    """Ask before a real robot moves: that of `cell` or of the settings. A simulation needs no
    confirmation. Raises ExecutionAborted: the plan was not confirmed."""
    if _is_real(run, cell) and run.ready and not callbacks.may_move(run):
        raise ExecutionAborted("the plan was not confirmed; nothing has moved")


def _resolve_measure(settings: Settings, scene: Scene | None) -> tuple[Parameter, ...] | None:
    """Resolve the parameters that `measure` names; None where it names none. Raises InputError: no
    such parameter, no scene to have it, or the request asks for others."""
    if not settings.measure:
        return None
    if scene is None:
        raise InputError("measure= names parameters of a scene: give scene=D.xml")
    if settings.planner == "exhaustive":
        raise InputError("the exhaustive planner measures everything: leave out measure=")
    measure = named_parameters(settings.measure, scene)
    # Compare with the parameters that the request asks for; a contradiction is an error.
    read = None
    if settings.request is not None:
        read = requested_parameters(settings.request, scene, settings.remeasure)
    if read is not None and set(read) != set(
        requested_parameters(None, scene, True, measure) or measure
    ):
        asked = ", ".join(str(parameter) for parameter in read)
        raise InputError(
            f"the request asks for {asked}, and measure={','.join(settings.measure)} for something "
            "else: give one of them"
        )
    return measure


def _pictures(
    planner: Planner, settings: Settings, scene: Scene | None, poses: Poses
) -> tuple[tuple[bytes, ...], tuple[str, ...]]:
    """Take pictures of the workspace (PNG) for a planner that uses them, if none were given. Return
    the pictures, and notes on those that failed."""
    looks = scene is None or (isinstance(planner, Observant) and planner.looks)
    if settings.images or not looks or "image" in settings.model_settings.without:
        return (), ()
    return pictures_of(settings, scene, poses)


@contextmanager
def _image_files(given: tuple[Path, ...], taken: Sequence[bytes]) -> Generator[tuple[Path, ...]]:
    """Yield the given images, else the pictures of the workspace as temporary files."""
    if given or not taken:
        yield given
        return
    with TemporaryDirectory() as folder:
        # Planners read files: write the pictures under fixed names.
        paths: list[Path] = []
        for name, content in zip(("workspace.png", "closer.png"), taken, strict=False):
            paths.append(Path(folder) / name)
            paths[-1].write_bytes(content)
        yield tuple(paths)


def _detected_scene(answer: Plan, seen: DetectedScene | None) -> Scene:
    """Scene that a model detected in the picture; empty for a rejection without one."""
    if seen is not None:
        return seen.scene()
    if answer.tree is not None:
        raise InputError(
            "the plan comes without the objects of its scene: give the MJCF with scene=D.xml"
        )
    return parse_scene("<mujoco><worldbody/></mujoco>")


def _add_left_out(answer: Plan, wanted: Sequence[Parameter]) -> Plan:
    """Note the requested parameters that a plan of a model or a file omits without a reason."""
    # Parameters with a stated reason are not omissions.
    explained = {parameter for item in answer.unmeasured for parameter in item.parameters}
    left_out = [item for item in wanted if item not in explained | set(answer.parameters)]
    if answer.tree is None or not left_out:
        return answer
    more = UnmeasuredParameters("The plan does not measure it.", tuple(left_out))
    return replace(answer, unmeasured=(*answer.unmeasured, more))


def _add_reading_note(settings: Settings, answer: Plan, scene: Scene) -> Plan:
    """Add a note if the parameters of a plan differ from those that the symbolic planner reads from the request.

    The plan is one of a model or a file. It stays unchanged: its author decides the meaning of the
    request.
    """
    if (
        settings.planner in OWN
        or settings.request is None
        or settings.measure
        or "text" in settings.model_settings.without
    ):
        return answer
    # Read the request by the symbolic planner's rules.
    wanted = requested_parameters(settings.request, scene, settings.remeasure)
    if answer.tree is None or wanted is None or set(wanted) == set(answer.parameters):
        return answer
    asked = ", ".join(str(parameter) for parameter in wanted)
    note = (
        f"By its words the request asks for {asked}; the plan measures what its author took it for."
    )
    return replace(answer, notes=(*answer.notes, note))
