"""Building stage: the twin, and its comparison with the recorded execution."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from functools import partial
from importlib import import_module
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from palpate.common.pose import Array
from palpate.common.processes import Fork, interrupts, shared_out
from palpate.estimation.estimate import Estimate
from palpate.estimation.evidence import remove_spoiled
from palpate.estimation.quantities.size import size_on_the_way
from palpate.execution.cell import Cell
from palpate.planning.plan import Plan, part_of
from palpate.planning.symbolic.planner import split_known
from palpate.primitives.state import SymbolicState
from palpate.robots.owner import measured_arm
from palpate.runs.callbacks import SILENT, RunCallbacks
from palpate.runs.executing import perform
from palpate.runs.run import Run
from palpate.scene.scene import Scene
from palpate.trace.recording import Activity, LeafRun, Recording
from palpate.trace.samples import FORCES, Trace
from palpate.twin.twin import build_twin as build
from palpate.twin.twin import touch
from palpate.twin.validate import REST, Means, Replay, empty_motions, mean_recordings

if TYPE_CHECKING:
    from palpate.perception.film import Shot
    from palpate.robots.simulated.world import World


# s between two ticks of an execution that is compared only in the means of its recordings. It
# equals the time that the simulated arm continues without new feed-forward torques. Against 0.02 s,
# residuals differ by less than 6 mN and 0.3 micrometres (bottle, hammer, drawer), and the duration
# falls by a seventh to a fifth.
REPLAY_PERIOD = 0.04
# Physics steps in a control cycle of such an execution. The step is 1 ms, half MuJoCo's default and
# twice that of an execution on the robot. Residuals of 1 to 2 N change by 1 to 4 mN (drawer: 16
# mN), and the duration falls by a quarter to a third.
REPLAY_SUBSTEPS = 1
# Activities that change the position of a fixture.
LASTING: tuple[Activity, ...] = ("working", "limit")
HANDS = (OPENS := "OpenGripper", "CloseGripper")


class PlanPart(NamedTuple):
    """Part of a plan, with the scene in which it begins, and joint angles (7,), rad; None: home."""

    plan: Plan
    scene: Scene
    q: Array | None = None


class TemplateRun(NamedTuple):
    """Execution in the scene as given: the means of its recordings, and a shot for the film."""

    felt: Means
    shot: Shot


def execute_in_given_scene(plan: Plan, scene: Scene) -> TemplateRun:
    """Execute a plan in the scene for which it was made."""
    from palpate.perception.film import Footage, Shot

    trace, world = _execute_part(scene, PlanPart(plan, scene))
    return TemplateRun(mean_recordings(trace), Shot.of(Footage(world.model, tuple(world.frames))))


def replay_parts(parts: Sequence[PlanPart], world: Scene) -> Means:
    """Execute the parts in `world`, and return the means of all recordings."""

    def means(part: PlanPart) -> Means:
        return mean_recordings(_execute_part(world, part)[0])

    return [mean for each in shared_out(means, parts) for mean in each]


def _execute_part(world: Scene, part: PlanPart) -> tuple[Trace, World]:
    """Execute a part in `world` with a noise-free simulated robot. Return the trace, and the world at the end."""
    from palpate.robots.simulated.robot import MujocoRobot

    plan, scene, q = part
    arm = measured_arm(scene.arm)
    # A robot without noise, with coarser physics and ticks than an execution.
    robot = MujocoRobot(world.spec(), scene.pose_world_base, arm, substeps=REPLAY_SUBSTEPS, q=q)
    with interrupts() as signals, signals.raise_in_block():
        done = perform(plan, scene, robot, noiseless=True, tick_period=REPLAY_PERIOD)
    return done.trace, robot.world


def replay_of(
    plan: Plan, scene: Scene, trace: Trace, estimates: Collection[Estimate]
) -> Replay | None:
    """Make the execution in a given world of the parts of a plan that are compared; None without recordings.

    The plan was made for `scene`; `trace` is of its execution. Its later parts know the `estimates`.
    """
    # Cut the plan into independent parts, which run in parallel.
    nodes = [leaf.node for leaf in trace.leaves]
    if len(set(nodes)) < len(nodes):  # a node ran twice: no part of one plan covers that
        return partial(replay_parts, [PlanPart(plan, scene)])
    parts = list(_parts(plan, scene, trace, estimates))
    if not parts:
        return None

    # Execute the parts; if a recording is missing, a part depends on an earlier one: execute the
    # whole plan.
    def replay(world: Scene) -> Means:
        means = replay_parts(parts, world)
        if len(parts) > 1 and len(means) < len(trace.recordings):
            return replay_parts([PlanPart(plan, scene)], world)  # a part depends on one before it
        return means

    return replay


def _parts(
    plan: Plan, scene: Scene, trace: Trace, estimates: Collection[Estimate]
) -> Iterator[PlanPart]:
    """Cut a plan into parts. Each ends with a recording and begins at a rest before the next one."""
    leaves, recordings = trace.leaves, trace.recordings
    if not recordings:
        return
    opens = next((leaf.node for leaf in leaves if leaf.primitive == OPENS), "")
    # Parts may begin at rests only if no touch corrects a pose.
    certain = all(body.covariance is None for body in scene.bodies.values())
    places = list(iter_rests(leaves)) if certain else []
    # Walk through the recordings; each part collects those that no rest separates.
    first, ends, q = 0, 0.0, None
    for before, after in zip(recordings, [*recordings[1:], None], strict=True):
        start = leaves[first].start
        # Extend the part to the last motion that its recording is compared with.
        ends = max(ends, *_compared_interval(trace, before, start))
        begins = None
        # Begin the next part at the latest rest between this part and the next recording; otherwise
        # merge them.
        if after is not None:
            earliest, _ = _compared_interval(trace, after, before.end)
            begins = max((i for i in places if ends <= leaves[i].start <= earliest), default=None)
            if begins is None:
                continue
        # A later part begins with the knowledge and joint positions of that time.
        at = scene
        if first:
            # Apply the estimates that were converted before that time.
            state = SymbolicState(scene)
            for estimate in estimates:
                converted = trace.converted(estimate.parameter)
                if estimate.has_value and converted is not None and converted.end < start:
                    state = state.learn_parameter(
                        estimate.parameter, tuple(estimate.values.tolist())
                    )
            at = state.scene
            q = np.mean(trace.samples.between(start - REST, start).q, axis=0)
        nodes = [leaf.node for leaf in leaves[first:begins] if leaf.start < ends]
        yield PlanPart(part_of(plan, [opens, *nodes]), at, q)
        first = begins or first


def _compared_interval(trace: Trace, recording: Recording, since: float) -> tuple[float, float]:
    """First and last robot time, s, of a recording and of the empty-hand motions that it is compared with.

    These are the motions after `since` and before the recording, or else the first one after it. If
    no motion is after `since`, all are candidates.
    """
    # Forces are compared with those of the empty hand at the same pose.
    empty: list[LeafRun] = []
    if recording.buffer == FORCES:
        every = list(empty_motions(trace, recording))
        later = [leaf for leaf in every if leaf.start >= since] or every
        empty = [leaf for leaf in later if leaf.end <= recording.start] or later[:1]
    used = [recording, *empty]
    return min(r.start for r in used), max(r.end for r in used)


def iter_rests(leaves: Sequence[LeafRun]) -> Iterator[int]:
    """Indices of motions before which the open hand is at rest in free air and no object was displaced."""
    is_open = False
    for i, (leaf, after) in enumerate(pairwise(leaves), 1):
        now, then = leaf.context, after.context
        # Displacements end the search: a fixture has moved, or an object was put down elsewhere.
        if now is None or then is None or now.activity in LASTING:
            return
        if now.holding is not None and then.holding is None and now.at != now.grasp:
            return
        if leaf.primitive in HANDS:
            is_open = leaf.primitive == OPENS
        still = now.activity == "still" and now.holding is None and leaf.end <= after.start
        if is_open and still and leaf.primitive == "MovePose" and after.primitive not in HANDS:
            yield i


# The digital twin, and its validation by executing the plan again in simulation.


def build_twin(run: Run, callbacks: RunCallbacks = SILENT) -> Run:
    """Write the estimates into the scene's MJCF.

    A scene detected in a picture is taken from the symbolic state at the end of the execution.
    """
    if run.trace_if_any is None:
        return run
    callbacks.progress("building the twin")
    scene = run.scene
    if run.seen and run.final_state is not None:
        scene = run.final_state.scene
    written = estimates_to_write(run, run.estimates)
    twin = build(scene, written, on_the_way=estimate_unasked_sizes(run, scene))
    return replace(run, scene=scene, finished=twin)


def estimates_to_write(run: Run, estimates: Sequence[Estimate]) -> list[Estimate]:
    """Leave out values that the scene states, unless the user asked to measure them again."""
    estimate_of = {e.parameter: e for e in estimates}
    is_asked = not run.is_recorded or run.settings.remeasure
    return [estimate_of[e] for e in split_known(estimate_of, run.scene, is_asked)[1]]


def estimate_unasked_sizes(run: Run, scene: Scene) -> list[Estimate]:
    """Estimate sizes that were not requested, from the grasps and touches of the run.

    The objects are those of `scene` whose sizes are from a picture or marked unsure.
    """
    trace = run.trace_if_any
    asked = {parameter.object for parameter in run.plan.parameters if parameter.quantity == "size"}
    if trace is None:
        return []
    # Objects with a measured size as a request need no second one.
    unsure = [body for body in scene.objects.values() if body.seen and body.name not in asked]
    sizes = [size_on_the_way(remove_spoiled(trace), body) for body in unsure]
    return [size for size in sizes if size is not None]


def fork_given_execution(run: Run, cell: Cell) -> AbstractContextManager[Fork[TemplateRun] | None]:
    """Execute the plan in the scene as given, in parallel with the execution on the robot.

    None if the twin will not be validated, or if a real robot needs the processor.
    """
    if run.settings.fast or run.seen or not cell.simulated:
        return nullcontext()
    # Both executions need the simulated arm: a copy would import it again.
    import_module("palpate.robots.simulated.robot")
    import_module("scipy.linalg.lapack")
    # This execution depends on no estimate, so it need not wait for them.
    return Fork(lambda: execute_in_given_scene(run.plan, run.scene))


def touch_twin(
    run: Run,
    planned_in: Scene,
    callbacks: RunCallbacks = SILENT,
    given: Fork[TemplateRun] | None = None,
) -> Run:
    """Validate the twin: execute the plan in it and in the scene as given, and compare with the run's recordings.

    The planner knew the scene `planned_in`. `given` is the execution in it; else it is executed here.
    """
    if run.finished is None:
        return run
    callbacks.progress("validating the twin in simulation")
    trace = run.trace_if_any
    if trace is None:
        return run
    # Cut the trace before the first leaf outside the plan: a repetition, or a recovery.
    tree = run.plan.tree
    nodes = {path for path, _ in tree.walk()} if tree is not None else set[str]()
    others = [leaf.start for leaf in trace.leaves if leaf.node not in nodes]
    trace = trace.until(min(others)) if others else trace
    # Execute the plan's part of the trace again.
    again = replay_of(run.plan, planned_in, trace, run.estimates)
    if again is None:
        return run
    # `given` executed the whole plan: it is comparable only if the robot did so as well.
    whole = run.execution is not None and run.execution.status == "complete"
    replay_given = (lambda: given.result().felt) if given is not None and whole else None
    return replace(run, finished=touch(run.finished, run.scene, trace, again, replay_given))
