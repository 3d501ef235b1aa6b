"""The look before a run: the poses that a camera sees take the place of the scene's."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.callbacks import SILENT, RunCallbacks
from palpate.errors import ExecutionAborted, InputError, Unavailable
from palpate.geometry.pose import Pose
from palpate.robots.simulated.noise import DEFAULT_LEVEL
from palpate.runs.run import Run
from palpate.scene.load import replaced
from palpate.scene.scene import Scene
from palpate.settings import WORLD_CAMERA, Settings

if TYPE_CHECKING:
    from palpate.seeing.handeye.calibrated import Hand
    from palpate.seeing.look import Seen


def look(
    settings: Settings,
    scene: Scene | None,
    callbacks: RunCallbacks = SILENT,
    world: Path | Scene | None = None,
) -> tuple[Scene | None, Seen | None]:
    """The scene with its objects where the settings' camera sees them, and what it saw; without a camera
    the scene as it is, and None.

    Args:
        world: the simulated world, where the settings name no file of it.

    Raises:
        InputError: no such camera, nothing to see by, or no world for its camera.
        Unavailable: OpenCV is not installed, or a camera or pose estimator does not answer.
        ExecutionAborted: what was seen was not confirmed.
    """
    if settings.camera is None or scene is None:
        return scene, None
    hidden = None
    if settings.camera.startswith(WORLD_CAMERA):
        # A world made of the scene itself would be moved to where its camera saw things.
        hidden = world or settings.world
        if hidden is None:
            raise InputError(
                f"camera={settings.camera} is a camera of the simulated world: give world=W.xml"
            )
    callbacks.progress("looking")
    robot, found = settings.robot, scene
    seen = seen_from(
        scene,
        settings.camera,
        settings.intrinsics,
        hidden,
        settings.seed,
        settings.pose_estimator,
        settings.noise,
        None if robot is None else lambda: hand_of(robot, found),
    )
    if not callbacks.looked(seen):
        raise ExecutionAborted("what the camera saw was not confirmed; nothing has moved")
    return replaced(scene, seen.entries), seen


def seen_from(
    scene: Scene,
    source: str,
    intrinsics: Path | None = None,
    world: Path | Scene | None = None,
    seed: int = 0,
    estimator: str | None = None,
    noise: str = DEFAULT_LEVEL,
    hand: Hand | None = None,
) -> Seen:
    """Poses of a scene by a source of pictures; arguments as those of `palpate.api.seeing.see`, the noise model of
    the embedded arm, and where the TCP is, for a camera on the hand.

    Raises:
        InputError: no such camera, nothing to see by, or a file that cannot be used.
        Unavailable: OpenCV is not installed, or a camera or pose estimator does not answer.
    """
    from palpate.seeing.look import look as look_at
    from palpate.seeing.sources import pictures

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
    from palpate.cells.simulated import simulated_cell
    from palpate.seeing.handeye.embedded import HAND, believed, with_camera
    from palpate.seeing.rendered import SimulatedCamera

    cell = simulated_cell(scene, world, noise=noise, seed=seed)
    name = source.removeprefix(WORLD_CAMERA)
    if name != HAND:
        eye = SimulatedCamera(cell.world.spec(cell.drawn), name, seed=seed)
        taken, depth = eye.shoot(), None if estimator is None else eye.depth()
        return look_at(scene, [taken], eye.lens, eye.mount, estimator, None, depth)
    robot = cell.robot()
    footage, (lens, mount) = cell.footage(), believed(seed)
    assert footage is not None
    assert footage.spec is not None
    eye = SimulatedCamera(with_camera(footage.spec, scene.arm), HAND, seed=seed)
    qpos = footage.frames[-1][1]
    taken, depth = eye.shoot(qpos), None if estimator is None else eye.depth(qpos)
    state = robot.state
    robot.close()
    return look_at(scene, [taken], lens, mount, estimator, lambda: state.pose_world_tcp, depth)


def hand_of(url: str, scene: Scene) -> Pose:
    """Where the TCP of the real arm at a URL is, world.

    Raises:
        Unavailable: it does not answer, or its driver does not say.
    """
    from palpate.cells.registry import drivers

    guided = drivers().of(url).guided
    if guided is None:
        raise Unavailable(
            f"the driver of '{url}' does not say where the hand is: state the joints= at which the camera looks in its "
            "intrinsics file, and see first"
        )
    hand = guided(url, scene)
    try:
        return hand.where()[0]
    finally:
        hand.close()


def require_seen(made: Run, seen: Seen | None) -> Run:
    """The planned run with what is to be said of the look, where there was one.

    Raises:
        InputError: the plan touches objects that were not seen.
    """
    if seen is None:
        return made
    touched = set(_touched(made))
    blind = [name for name in seen.unseen if name in touched]
    if blind:
        raise InputError(
            f"the camera did not see {', '.join(blind)}: bring each, or a tag of it, into view, or do not ask for "
            "what would touch them"
        )
    notes = [f"The look: {note}." for note in seen.notes]
    if seen.unseen:
        notes.append(f"Not seen, and taken to stand as stated: {', '.join(seen.unseen)}.")
    picture = None if seen.outlines is None else seen.outlines.png()
    plan = replace(made.plan, notes=(*made.plan.notes, *notes))
    return replace(made, plan=plan, looked=picture)


def _touched(made: Run) -> Iterator[str]:
    """Objects and surfaces that are asked for, or that an action of the plan names."""
    yield from (parameter.object for parameter in made.plan.parameters)
    if made.plan.tree is None:
        return
    for _, node in made.plan.tree.walk():
        for _, value in node.args:
            # Names that do not exist are findings of the check.
            with suppress(InputError):
                subject = made.scene.symbols.subject(value) if isinstance(value, str) else None
                if subject is not None:
                    yield subject
