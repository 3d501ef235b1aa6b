"""Executing stage: the behavior tree on the robot, and cameras that watch it."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from palpate.common.belief import SURE
from palpate.common.errors import InputError, Unavailable
from palpate.common.pose import Pose
from palpate.estimation.quantities.within import Within
from palpate.execution.cell import Cell
from palpate.execution.recovery import OnFailure, anyway, recover, repeat
from palpate.planning.plan import Plan
from palpate.primitives.base import Blackboard, LeafFailure, Settled, keep_state
from palpate.primitives.state import SymbolicState
from palpate.robots.robot import Remembering, Robot
from palpate.runs.callbacks import SILENT, RunCallbacks
from palpate.runs.run import Ending, Run
from palpate.runs.settings import WORLD_CAMERA
from palpate.runs.workplace import footage_of, robot_of
from palpate.scene.scene import Scene

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from palpate.execution.runner import Execution, Keep
    from palpate.perception.lens import Lens, Mount
    from palpate.perception.look import Seen

    # A picture with lens and mount of its camera, and perhaps with depth.
    Shot = tuple[Lens, Mount | None, NDArray[np.uint8], NDArray[np.uint16] | None]


# m: distance of an object from its believed position that is allowed in addition to the uncertainty
# of sight, as for neighbours in a rehearsal.
MOVED = 0.005
LOOK_PERIOD = 5.0  # s of robot time: least interval between two looks


See = Callable[[], "Seen | None"]  # Take a look; None where the camera shows nothing of the scene


@dataclass(slots=True)
class CameraWatch:
    """Corrects the symbolic state after a motion, and takes a look when the view is free."""

    settled: Settled  # the correction
    see: See  # takes a look
    _looked: float = field(default=-np.inf, init=False)

    def __call__(self, path: str, blackboard: Blackboard) -> SymbolicState:
        """Correct the state after the leaf at a path. Raises LeafFailure: an object is not at its
        believed position, or the camera does not answer."""
        state, now = self.settled(path, blackboard), blackboard.robot.state.t
        if now - self._looked < LOOK_PERIOD or blackboard.motions > 1 or not _is_away(state):
            return state
        # Compare the seen positions with the believed ones.
        self._looked = now
        try:
            seen = self.see()
        except Unavailable as error:
            raise LeafFailure(f"the look after the motion failed: {error}") from error
        if seen is not None and (displacements := [*iter_displacements(state, seen)]):
            raise LeafFailure(f"{'; '.join(displacements)}: see what moved it, and look again")
        return state


def iter_displacements(state: SymbolicState, seen: Seen) -> Iterator[str]:
    """Describe the objects that are not at their believed positions, with position and distance."""
    for name, pose in seen.poses.items():
        # Covariance of the horizontal difference: sight and belief add.
        belief, spread = state.belief_of(name), seen.covariances[name][:2, :2]
        if belief is not None:
            spread = spread + belief.covariance[:2, :2]
        # Allow the nearer of the believed and the first seen position; test along the displacement.
        ways = [(pose.position - place.position)[:2] for place in _places(state, name)]
        off = min(ways, key=lambda offset: float(offset @ offset))
        far = float(np.linalg.norm(off))
        along = float(np.sqrt(off @ spread @ off)) / far if far > 0.0 else 0.0
        most = MOVED + SURE * along
        if far > most:
            x, y, z = pose.position
            yield (
                f"'{name}' is seen at ({x:.3f}, {y:.3f}, {z:.3f}) m, {1e3 * far:.0f} mm from where it is believed, and "
                f"{1e3 * most:.0f} mm are what sight leaves open"
            )


def _places(state: SymbolicState, name: str) -> Iterator[Pose]:
    """Believed pose of an object. For an object that the run has not moved, also the first seen
    pose, which touch may have corrected.
    """
    yield state.pose_of(name)
    if name not in state.displaced_objects():
        yield (state.scene.as_given or state.scene).body(name).pose_world


def watch_state(settled: Settled, see: See | None) -> Settled:
    """Add looks to the correction; without a camera it stays unchanged."""
    return settled if see is None else CameraWatch(settled, see)


def eye(run: Run, cell: Cell) -> See | None:
    """Make the looks of the settings' camera; None without one, and of a file, which shows nothing new."""
    settings, source = run.settings, run.settings.camera
    if source is None:
        return None
    from palpate.perception.cameras import PICTURES, VIDEOS, Stream
    from palpate.perception.look import look

    if source.lower().endswith((*PICTURES, *VIDEOS)):
        return None
    estimator = settings.pose_estimator
    # A real camera streams from here on; every look takes its latest picture.
    if source.startswith(WORLD_CAMERA):
        take = _simulated_pictures(source.removeprefix(WORLD_CAMERA), run, cell)
    else:
        stream = Stream(source, settings.intrinsics, estimator is not None)

        def take() -> Shot:
            return stream.lens, stream.mount, stream.latest(), stream.depth()

    def see() -> Seen | None:
        lens, mount, picture, depth = take()
        # The arm may hide everything that identifies a pose.
        with suppress(InputError):
            return look(run.scene, [picture], lens, mount, estimator, None, depth)
        return None

    return see


def _simulated_pictures(name: str, run: Run, cell: Cell) -> Callable[[], Shot]:
    """Make the pictures of a camera in the simulated world, arm included."""
    from palpate.perception.rendered import SimulatedCamera

    settings, cameras = run.settings, list[SimulatedCamera]()

    def take() -> Shot:
        # Render the picture from the latest state of the simulation.
        footage = cell.footage()
        assert footage is not None
        assert footage.spec is not None
        if not cameras:
            cameras.append(SimulatedCamera(footage.spec, name, seed=settings.seed))
        camera, qpos = cameras[0], footage.frames[-1][1]
        depth = None if settings.pose_estimator is None else camera.depth(qpos)
        return camera.lens, camera.mount, camera.shoot(qpos), depth

    return take


def _is_away(state: SymbolicState) -> bool:
    """True if the hand is empty, touches nothing, and has nothing between its fingers."""
    if state.holding is not None or state.activity != "still":
        return False
    return state.object_at(state.pose_world_tcp) is None


# Execution of the behavior tree on the cell's robot, with the trace.

log = logging.getLogger(__name__)


def execute(
    run: Run, cell: Cell, callbacks: RunCallbacks = SILENT, keep: Keep | None = None
) -> Run:
    """Execute the plan on the cell's robot. `keep` writes samples to disk meanwhile."""
    # Connect camera and robot before the first motion.
    see = eye(run, cell)
    robot, before = robot_of(cell, callbacks.may_resume)
    callbacks.progress(f"executing on the {'simulated' if cell.simulated else 'real'} robot")
    done = perform(
        run.plan,
        run.scene,
        robot,
        callbacks,
        run.settings.on_failure,
        within=run.settings.within,
        keep=keep,
        real=not cell.simulated,
        settled=keep_state if run.rehearsal is None else run.rehearsal.foresight.settled,
        see=see,
        is_rehearsed=run.rehearsal is not None,
    )
    # Keep everything that later stages need, and the earlier setbacks.
    ending = Ending.of(done)
    return replace(
        run,
        world=cell.description,
        simulated=cell.simulated,
        execution=replace(ending, setbacks=(*before, *ending.setbacks)),
        final_state=done.final_state,
        beliefs=done.final_state.seen,
        recorded=done.trace,
        black_box=robot.black_box() if isinstance(robot, Remembering) else None,
        footage=footage_of(cell),
    )


def perform(
    plan: Plan,
    scene: Scene,
    robot: Robot,
    callbacks: RunCallbacks = SILENT,
    on_failure: OnFailure = "stop",
    *,
    within: Within | None = None,
    keep: Keep | None = None,
    real: bool = False,
    noiseless: bool = False,
    settled: Settled = keep_state,
    see: See | None = None,
    tick_period: float | None = None,
    is_rehearsed: bool = False,
) -> Execution:
    """Run the tree on the robot, and close the robot in any case.

    Args:
        plan: with a tree.
        scene: for which the plan was made.
        robot: simulated or real.
        callbacks: progress, and the confirmation to resume after a stop of a real robot.
        on_failure: `stop`, `skip` the failed object, or `replan`.
        within: half widths of 95 % intervals; a measurement with a wider one is repeated.
        keep: writes samples to disk meanwhile.
        real: the robot is a real one.
        noiseless: the robot is a simulated one without noise.
        settled: corrects the symbolic state after a leaf of the plan, by the final poses of its
            rehearsal.
        see: looks at the scene after motions; a displaced object ends the run.
        tick_period: s of robot time between two ticks; the runner's by default.
        is_rehearsed: the plan was rehearsed, so that further plans are rehearsed, too.
    """
    from palpate.execution.runner import TICK_PERIOD
    from palpate.execution.runner import run as run_tree

    # Options that the first attempt and all repetitions share.
    attempt = partial(
        run_tree,
        observer=callbacks.observer,
        keep=keep,
        noiseless=noiseless,
        settled=watch_state(keep_state, see),
        tick_period=tick_period or TICK_PERIOD,
    )
    may_run = partial(_is_harmless, say=callbacks.progress) if is_rehearsed else anyway
    try:
        # Execute, recover from failures by the policy, then repeat measurements that are too
        # uncertain.
        first = attempt(
            plan, scene, robot, settled=settled if see is None else CameraWatch(settled, see)
        )
        done = recover(
            first,
            plan,
            scene,
            robot,
            policy=on_failure,
            run=attempt,
            real=real,
            may_resume=callbacks.may_resume,
            may_run=may_run,
        )
        if within:
            done = repeat(
                done,
                plan,
                scene,
                robot,
                within=within,
                run=attempt,
                say=callbacks.progress,
                may_run=may_run,
            )
        return done
    finally:
        try:
            robot.close()
        except Exception as error:  # the measurements are kept all the same
            log.warning("the robot was not closed: %s: %s", type(error).__name__, error)


def end_execution(run: Run) -> Run:
    """End the execution of a run whose process was killed, with the trace recorded so far."""
    try:
        trace = run.trace_if_any
    except InputError:  # the file was cut off too early to be read
        trace = None
    # Estimate the figures of the execution from the trace.
    leaves = trace.leaves if trace is not None else ()
    seconds = 0.0
    if trace is not None and len(trace.samples):
        seconds = float(trace.t[-1] - trace.t[0])
    # All actions of the plan succeeded: the execution was complete.
    ended_well = sum(leaf.status == "SUCCESS" for leaf in leaves) == run.plan.actions
    ending = Ending(
        "complete" if ended_well else "stopped",
        stopped_by=None if ended_well else "the process ended while the plan was executed",
        actions=len(leaves),
        robot_seconds=seconds,
        wall_seconds=0.0,
    )
    return replace(run, execution=ending, recorded=trace)


def _is_harmless(plan: Plan, scene: Scene, say: Callable[[str], None]) -> bool:
    """Rehearse a further plan, while the robot rests; False if it fails in simulation."""
    from palpate.execution.rehearsal import rehearse

    say("rehearsing what follows")
    finding = rehearse(plan, scene).finding
    if finding is not None:
        log.warning("no further attempt: %s", finding.message)
    return finding is None
