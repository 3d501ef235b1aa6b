"""The look before a run: the poses that a camera sees take the place of the scene's."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.callbacks import SILENT, RunCallbacks
from palpate.errors import ExecutionAborted, InputError
from palpate.runs.run import Run
from palpate.scene.load import replaced
from palpate.scene.scene import Scene
from palpate.settings import WORLD_CAMERA, Settings

if TYPE_CHECKING:
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
    lens, estimator = settings.intrinsics, settings.pose_estimator
    seen = seen_from(scene, settings.camera, lens, hidden, settings.seed, estimator)
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
) -> Seen:
    """Poses of a scene by a source of pictures; arguments as those of `palpate.api.seeing.see`.

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
        taken, lens, mount = pictures(source, intrinsics)
        return look_at(scene, taken, lens, mount, estimator)
    if intrinsics is not None:
        raise InputError(
            "a camera of the simulated world has its own intrinsics: leave out intrinsics="
        )
    from palpate.cells.simulated import simulated_cell
    from palpate.seeing.rendered import take

    cell = simulated_cell(scene, world, seed=seed)
    picture = take(cell.world.spec(cell.drawn), source.removeprefix(WORLD_CAMERA), seed=seed)
    return look_at(scene, [picture.pixels], picture.lens, picture.mount, estimator)


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
