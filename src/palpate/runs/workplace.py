"""The workplace that the settings name, and the look of its camera before a run."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.common.errors import ExecutionAborted, InputError, PalpateError, Stopped, Unavailable
from palpate.common.parameter import Parameter
from palpate.common.pose import Pose
from palpate.execution.cell import Cell, Close
from palpate.execution.cell_drivers import drivers
from palpate.execution.recovery import Resume, confirmed_reason
from palpate.robots.noise_levels import DEFAULT_LEVEL
from palpate.robots.owner import require_same
from palpate.robots.robot import Recoverable, Robot
from palpate.runs.callbacks import SILENT, RunCallbacks
from palpate.runs.run import Run
from palpate.runs.settings import WORLD_CAMERA, Settings, noise_source
from palpate.scene.load import replace_objects
from palpate.scene.poses import Poses
from palpate.scene.scene import Scene

if TYPE_CHECKING:
    from palpate.perception.film import Footage
    from palpate.perception.hand_eye import Hand
    from palpate.perception.look import Seen


log = logging.getLogger(__name__)


def cell_for(settings: Settings, scene: Scene | None, seen: bool = False) -> Cell:
    """Make the cell that the settings name, for work in `scene`, which was perhaps `seen` in a picture."""
    from palpate.execution.simulated_cell import simulated_cell

    # Require the calibration of this same arm.
    simulated = (noise_source(settings.noise), settings.seed) if settings.robot is None else None
    require_same(settings.described_arm().config, simulated)
    if settings.robot is not None:
        return drivers().connect(settings.robot, scene)
    return simulated_cell(
        scene,
        settings.world,
        noise=settings.noise,
        seed=settings.seed,
        seen=seen,
        arm=settings.described_arm(),
        root=settings.root,
        robot_body=settings.robot_body,
    )


def pictures_of(
    settings: Settings, scene: Scene | None, poses: Poses
) -> tuple[tuple[bytes, ...], tuple[str, ...]]:
    """Take pictures of the workspace (PNG).

    They are one by the camera of `poses`, if it states one, and a close-up of a scene. There are
    none without scene, world or robot, and without OpenGL.

    Returns:
        The pictures, and a note for each one that failed.
    """
    if scene is None and settings.world is None and settings.robot is None:
        return (), ()
    # Take each picture separately: one failure must not prevent the other.
    cell = cell_for(settings, scene)
    # The overview always, the close-up if the cell has one.
    cameras: dict[str, Callable[[], bytes | None]] = {
        "of the workspace": partial(cell.picture, poses.camera)
    }
    if scene is not None and isinstance(cell, Close):
        cameras["from nearby"] = cell.closer
    taken: list[bytes] = []
    notes: list[str] = []
    for which, take in cameras.items():
        try:
            picture = take()
        except Exception as error:
            log.warning("no picture %s: %s: %s", which, type(error).__name__, error)
            notes.append(f"There is no picture {which}: {error}".replace("\n", " "))
            continue
        if picture is not None:
            taken.append(picture)
    return tuple(taken), tuple(notes)


def robot_of(cell: Cell, may_resume: Resume) -> tuple[Robot, tuple[str, ...]]:
    """Get the cell's robot and its setbacks.

    If the robot reports an earlier stop, `may_resume` must confirm that it may recover.

    Raises:
        InputError: the workplace cannot be used.
        Unavailable: the robot is out of reach.
    """
    try:
        return cell.robot(), ()
    except Stopped as stopped:
        if not isinstance(cell, Recoverable) or not may_resume(str(stopped)):
            raise
        cell.recover()
        return cell.robot(), (confirmed_reason(str(stopped)),)
    except PalpateError:
        raise
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        raise Unavailable(f"the robot cannot be used: {reason}") from error


def footage_of(cell: Cell) -> Footage | None:
    """Get the footage of the cell's camera; None on failure, which does not end the run."""
    try:
        return cell.footage()
    except Exception as error:
        log.warning("there is no film: %s: %s", type(error).__name__, error)
        return None


def truths(run: Run, cell: Cell) -> dict[Parameter, tuple[float, ...]]:
    """Read the true values of the estimated parameters, if the cell knows them."""
    truth: dict[Parameter, tuple[float, ...]] = {}
    for estimate in run.estimates:
        try:
            values = cell.truth(estimate.parameter)
        except Exception as error:
            log.warning("the truth is not known: %s: %s", type(error).__name__, error)
            break
        if values is not None:
            truth[estimate.parameter] = values
    return truth


# The look before a run: poses that a camera sees replace those of the scene.


def look(
    settings: Settings,
    scene: Scene | None,
    callbacks: RunCallbacks = SILENT,
    world: Path | Scene | None = None,
) -> tuple[Scene | None, Seen | None]:
    """Move the objects of a scene to the poses that the settings' camera sees.

    It looks at the simulated `world` if the settings name no file of it. Return the scene and the
    look; without a camera the unchanged scene and None.

    Raises:
        InputError: no such camera, nothing to see by, or no world for its camera.
        Unavailable: OpenCV is not installed, or a camera or pose estimator does not answer.
        ExecutionAborted: the look was not confirmed.
    """
    if settings.camera is None or scene is None:
        return scene, None
    hidden = None
    if settings.camera.startswith(WORLD_CAMERA):
        # Require a world file: a world made from the scene itself would follow the seen poses.
        hidden = world or settings.world
        if hidden is None:
            raise InputError(
                f"camera={settings.camera} is a camera of the simulated world: give world=W.xml"
            )
    callbacks.progress("looking")
    # A camera on the hand needs the pose of the hand, if the robot is a real one.
    robot, current = settings.robot, scene
    seen = look_at_source(
        scene,
        settings.camera,
        settings.intrinsics,
        hidden,
        settings.seed,
        settings.pose_estimator,
        settings.noise,
        None if robot is None else lambda: hand_of(robot, current),
    )
    if not callbacks.looked(seen):
        raise ExecutionAborted("what the camera saw was not confirmed; nothing has moved")
    return replace_objects(scene, seen.entries), seen


def look_at_source(
    scene: Scene,
    source: str,
    intrinsics: Path | None = None,
    world: Path | Scene | None = None,
    seed: int = 0,
    estimator: str | None = None,
    noise: str = DEFAULT_LEVEL,
    hand: Hand | None = None,
) -> Seen:
    """Determine the poses of a scene from a source of pictures; the arguments are those of `recordings.see`.

    `noise` is the model of the embedded arm, `hand` the pose of the TCP for a camera on the hand.

    Raises:
        InputError: no such camera, nothing to see by, or a file that cannot be used.
        Unavailable: OpenCV is not installed, or a camera or pose estimator does not answer.
    """
    from palpate.perception.cameras import pictures
    from palpate.perception.look import look as look_at

    # A real camera or a file: take pictures and look.
    if not source.startswith(WORLD_CAMERA):
        if world is not None:
            raise InputError(
                f"world= goes with camera={WORLD_CAMERA}NAME, a camera of the simulated world"
            )
        taken, lens, mount, depth = pictures(source, intrinsics, estimator is not None)
        return look_at(scene, taken, lens, mount, estimator, hand, depth)
    if intrinsics is not None:
        raise InputError(
            "a camera of the simulated world has its own intrinsics: leave out intrinsics="
        )
    from palpate.execution.simulated_cell import simulated_cell
    from palpate.perception.hand_eye import HAND, believed_camera, with_camera
    from palpate.perception.rendered import SimulatedCamera

    # Render the picture in the simulated world, by one of its cameras or by one on the hand.
    cell = simulated_cell(scene, world, noise=noise, seed=seed)
    name = source.removeprefix(WORLD_CAMERA)
    if name != HAND:
        eye = SimulatedCamera(cell.world.spec(cell.drawn), name, seed=seed)
        taken, depth = eye.shoot(), None if estimator is None else eye.depth()
        return look_at(scene, [taken], eye.lens, eye.mount, estimator, None, depth)
    robot = cell.robot()
    footage, (lens, mount) = cell.footage(), believed_camera(seed)
    assert footage is not None
    assert footage.spec is not None
    eye = SimulatedCamera(with_camera(footage.spec, scene.arm), HAND, seed=seed)
    qpos = footage.frames[-1][1]
    taken, depth = eye.shoot(qpos), None if estimator is None else eye.depth(qpos)
    state = robot.state
    robot.close()
    return look_at(scene, [taken], lens, mount, estimator, lambda: state.pose_world_tcp, depth)


def hand_of(url: str, scene: Scene) -> Pose:
    """Read the pose of the TCP of the real arm at a URL, in the world. Raises Unavailable: it does
    not answer, or its driver does not report the pose."""
    guided = drivers().of(url).guided
    if guided is None:
        raise Unavailable(
            f"the driver of '{url}' does not say where the hand is: state the joints= at which the camera looks in its "
            "intrinsics file, and see first"
        )
    # Connect only for the one pose.
    hand = guided(url, scene)
    try:
        return hand.where()[0]
    finally:
        hand.close()


def require_seen(run: Run, seen: Seen | None) -> Run:
    """Require that the camera saw every object that the plan touches, and add the notes of the
    look. Raises InputError: the plan touches objects that were not seen."""
    if seen is None:
        return run
    # An object that the plan touches must be seen; others only get a note.
    touched = set(_touched_names(run))
    blind = [name for name in seen.unseen if name in touched]
    if blind:
        raise InputError(
            f"the camera did not see {', '.join(blind)}: bring each, or a tag of it, into view, or do not ask for "
            "what would touch them"
        )
    # Keep the notes and the picture with the plan.
    notes = [f"The look: {note}." for note in seen.notes]
    if seen.unseen:
        notes.append(f"Not seen, and taken to stand as stated: {', '.join(seen.unseen)}.")
    picture = None if seen.outlines is None else seen.outlines.png()
    plan = replace(run.plan, notes=(*run.plan.notes, *notes))
    return replace(run, plan=plan, looked=picture)


def _touched_names(run: Run) -> Iterator[str]:
    """Objects and surfaces that are requested, or that an action of the plan names."""
    yield from (parameter.object for parameter in run.plan.parameters)
    if run.plan.tree is None:
        return
    for _, node in run.plan.tree.walk():
        for _, value in node.args:
            # Skip names that do not exist: the check reports them as findings.
            with suppress(InputError):
                subject = run.scene.symbols.subject(value) if isinstance(value, str) else None
                if subject is not None:
                    yield subject
