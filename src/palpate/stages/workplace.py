"""The robot cell that the settings name: its robot, camera pictures and true values."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from palpate.cells.cell import Cell, Close
from palpate.cells.registry import drivers
from palpate.errors import PalpateError, Stopped, Unavailable
from palpate.execution.recovery import Resume, confirmed
from palpate.parameter import Parameter
from palpate.robots.owner.arm import require_same
from palpate.robots.robot import Recoverable, Robot
from palpate.runs.run import Run
from palpate.scene.poses import Poses
from palpate.scene.scene import Scene
from palpate.settings import Settings, noise_source

if TYPE_CHECKING:
    from palpate.pictures.film import Footage

log = logging.getLogger(__name__)


def connected(settings: Settings, scene: Scene | None) -> Cell:
    """The cell of the real robot that the settings name.

    Raises:
        InputError: no such URL.
        Unavailable: no driver for it, or no answer.
    """
    assert settings.robot is not None
    return drivers().connect(settings.robot, scene)


def cell_for(settings: Settings, scene: Scene | None, seen: bool = False) -> Cell:
    """The cell that the settings name.

    Args:
        settings: of the run.
        scene: that the robot works in.
        seen: the scene was detected in a picture.

    Raises:
        InputError: world and scene do not match, or `robot.yaml` was measured on another arm.
        Unavailable: no driver for the robot.
    """
    from palpate.cells.simulated import simulated_cell

    simulated = (noise_source(settings.noise), settings.seed) if settings.robot is None else None
    require_same(settings.described_arm().config, simulated)
    if settings.robot is not None:
        return connected(settings, scene)
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
    """Take pictures of the workspace (PNG): by the camera of `poses` if it states one, and, with a
    scene, a close-up. None without scene, world or robot, and without OpenGL. One that cannot be made
    is a note in its place.

    Raises:
        InputError: world and scene do not match.
        Unavailable: no driver for the robot.
    """
    if scene is None and settings.world is None and settings.robot is None:
        return (), ()
    cell = cell_for(settings, scene)
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
    """The cell's robot, and its setbacks: if the robot reports an earlier stop, `may_resume` is asked
    to confirm that it may recover.

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
        return cell.robot(), (confirmed(str(stopped)),)
    except PalpateError:
        raise
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        raise Unavailable(f"the robot cannot be used: {reason}") from error


def footage_of(cell: Cell) -> Footage | None:
    """Footage of the cell's camera; None on failure, which does not end the run."""
    try:
        return cell.footage()
    except Exception as error:
        log.warning("there is no film: %s: %s", type(error).__name__, error)
        return None


def truths(made: Run, cell: Cell) -> dict[Parameter, tuple[float, ...]]:
    """True values of the estimated parameters, as far as the cell knows them."""
    found: dict[Parameter, tuple[float, ...]] = {}
    for estimate in made.estimates:
        try:
            values = cell.truth(estimate.parameter)
        except Exception as error:
            log.warning("the truth is not known: %s: %s", type(error).__name__, error)
            break
        if values is not None:
            found[estimate.parameter] = values
    return found
