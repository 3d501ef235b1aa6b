"""A camera that goes on looking while a plan runs: a thing that moved and was not meant to ends the run.

After each motion that leaves the hand empty and in free air, every object in a new picture is compared with
where it is believed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from palpate.cells.cell import Cell
from palpate.errors import InputError, Unavailable
from palpate.geometry.pose import Array, Pose
from palpate.runs.run import Run
from palpate.settings import WORLD_CAMERA
from palpate.vocabulary.base import Blackboard, LeafFailure, Settled
from palpate.vocabulary.state import SymbolicState

if TYPE_CHECKING:
    from palpate.seeing.look import Seen

MOVED = 0.005
"""m in the level that a thing may stand off, besides what sight leaves open: as a rehearsal's neighbours."""
SURE = 3.0
"""Standard deviations of what sight, and what is believed, leave open."""
OFTEN = 5.0
"""s of robot time from one look to the next, at least."""


See = Callable[[], "Seen | None"]
"""Takes a look; None where the camera shows nothing of the scene."""


@dataclass(slots=True)
class Watch:
    """Correction of the symbolic state after a motion, with a look where nothing is in the way.

    Attributes:
        settled: the correction.
        see: takes a look.
    """

    settled: Settled
    see: See
    _looked: float = field(default=-np.inf, init=False)

    def __call__(self, path: str, blackboard: Blackboard) -> SymbolicState:
        """State after the leaf at a path.

        Raises:
            LeafFailure: something stands elsewhere than believed, or the camera does not answer.
        """
        state, now = self.settled(path, blackboard), blackboard.robot.state.t
        if now - self._looked < OFTEN or blackboard.motions > 1 or not _is_away(state):
            return state
        self._looked = now
        try:
            seen = self.see()
        except Unavailable as error:
            raise LeafFailure(f"the look after the motion failed: {error}") from error
        if seen is not None and (found := [*displaced(state, seen)]):
            raise LeafFailure(f"{'; '.join(found)}: see what moved it, and look again")
        return state


def displaced(state: SymbolicState, seen: Seen) -> Iterator[str]:
    """Objects that stand elsewhere than believed, each with where and how far."""
    for name, pose in seen.poses.items():
        belief, spread = state.belief_of(name), seen.covariances[name][:2, :2]
        if belief is not None:
            spread = spread + belief.covariance[:2, :2]
        ways = [(pose.position - place.position)[:2] for place in _places(state, name)]
        off = min(ways, key=lambda way: float(way @ way))
        far, most = float(np.linalg.norm(off)), MOVED + SURE * _along(spread, off)
        if far > most:
            x, y, z = pose.position
            yield (
                f"'{name}' is seen at ({x:.3f}, {y:.3f}, {z:.3f}) m, {1e3 * far:.0f} mm from where it is believed, and "
                f"{1e3 * most:.0f} mm are what sight leaves open"
            )


def _places(state: SymbolicState, name: str) -> Iterator[Pose]:
    """Where an object is believed; and where it was seen at first, unless the run has moved it: touch may have
    corrected that."""
    yield state.pose_of(name)
    if name not in state.not_restored():
        yield (state.scene.as_given or state.scene).body(name).pose_world


def watched(settled: Settled, see: See | None) -> Settled:
    """The correction with looks; as it is without a camera."""
    return settled if see is None else Watch(settled, see)


def eye(made: Run, cell: Cell) -> See | None:
    """Looks of the settings' camera; None without one, and of a file, which shows nothing new.

    Raises:
        InputError: no such camera, or no intrinsics.
        Unavailable: it does not answer.
    """
    source = made.settings.camera
    if source is None:
        return None
    from palpate.seeing.sources import PICTURES, VIDEOS

    if source.lower().endswith((*PICTURES, *VIDEOS)):
        return None
    if source.startswith(WORLD_CAMERA):
        return _simulated(source.removeprefix(WORLD_CAMERA), made, cell)
    return _live(source, made)


def _live(source: str, made: Run) -> See:
    """Looks of a camera that runs from here on."""
    from palpate.seeing.look import look
    from palpate.seeing.sources import Stream

    settings = made.settings
    estimator = settings.pose_estimator
    stream = Stream(source, settings.intrinsics, estimator is not None)

    def see() -> Seen | None:
        lens, mount, pictures = stream.lens, stream.mount, [stream.latest()]
        return _or_none(
            lambda: look(made.scene, pictures, lens, mount, estimator, None, stream.depth())
        )

    return see


def _simulated(name: str, made: Run, cell: Cell) -> See:
    """Looks of a camera of the simulated world, arm included."""
    from palpate.seeing.look import look
    from palpate.seeing.rendered import SimulatedCamera

    estimator, cameras = made.settings.pose_estimator, list[SimulatedCamera]()

    def see() -> Seen | None:
        footage = cell.footage()
        assert footage is not None
        assert footage.spec is not None
        if not cameras:
            cameras.append(SimulatedCamera(footage.spec, name, seed=made.settings.seed))
        camera, qpos = cameras[0], footage.frames[-1][1]
        pictures, depth = [camera.shoot(qpos)], None if estimator is None else camera.depth(qpos)
        lens, mount = camera.lens, camera.mount
        return _or_none(lambda: look(made.scene, pictures, lens, mount, estimator, None, depth))

    return see


def _or_none(look: Callable[[], Seen]) -> Seen | None:
    """What is seen; None where the arm hides all that there is to see by."""
    try:
        return look()
    except InputError:
        return None


def _along(covariance: Array, way: Array) -> float:
    """Standard deviation, m, along a way (2,), m; 0 along none."""
    length = float(np.linalg.norm(way))
    return float(np.sqrt(way @ covariance @ way)) / length if length > 0.0 else 0.0


def _is_away(state: SymbolicState) -> bool:
    """True if the hand is empty, touches nothing, and has nothing between its fingers."""
    if state.holding is not None or state.activity != "still":
        return False
    return state.object_at(state.pose_world_tcp) is None
