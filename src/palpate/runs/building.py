"""Building stage: the twin, and its comparison with the recorded execution."""

from __future__ import annotations

from collections.abc import Collection, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from palpate.common.pose import Array
from palpate.common.processes import Beside, interrupts, shared_out
from palpate.estimation.estimate import Estimate
from palpate.estimation.quantities.size import size_on_the_way
from palpate.execution.cell import Cell
from palpate.mjcf.body import Body
from palpate.planning.plan import Plan, part_of
from palpate.primitives.state import SymbolicState
from palpate.runs.callbacks import SILENT, RunCallbacks
from palpate.runs.executing import perform
from palpate.runs.run import Run
from palpate.scene.scene import Scene
from palpate.trace.recording import Activity, LeafRun, Recording
from palpate.trace.samples import FORCES, Trace, sound
from palpate.twin.twin import build_twin as build
from palpate.twin.twin import touch
from palpate.twin.validate import REST, Felt, Replay, empty_motions, mean_recordings

if TYPE_CHECKING:
    from palpate.perception.film import Shot
    from palpate.robots.simulated.world import World


REPLAY_PERIOD = 0.04
"""s between two ticks of an execution that is compared only in the means of its recordings: as long as the simulated
arm goes on without new feed-forward torques. Residuals move by less than 6 mN and 0.3 micrometres (bottle,
hammer, drawer), in a seventh to a fifth less time than at 0.02 s."""
REPLAY_SUBSTEPS = 1
"""Physics steps in a control cycle of it: of 1 ms, half MuJoCo's default, and twice those of an execution. Residuals of
1 to 2 N move by 1 to 4 mN (drawer: 16 mN), in a quarter to a third less time."""
LASTING: tuple[Activity, ...] = ("working", "limit")
"""Activities that leave a fixture elsewhere."""
HANDS = (OPENS := "OpenGripper", "CloseGripper")


class PlanPart(NamedTuple):
    """Part of a plan, with the scene in which it begins, and joint angles (7,), rad; None: home."""

    plan: Plan
    scene: Scene
    q: Array | None = None


class Given(NamedTuple):
    """Execution in the scene as given: what was felt, and how a film of it is taken."""

    felt: Felt
    shot: Shot


def touched_as_given(plan: Plan, scene: Scene) -> Given:
    """Execute a plan in the scene that it was made for."""
    from palpate.perception.film import Footage, Shot

    trace, world = _execute_part(scene, PlanPart(plan, scene))
    return Given(mean_recordings(trace), Shot.of(Footage(world.model, tuple(world.frames))))


def replay_parts(parts: Sequence[PlanPart], world: Scene) -> Felt:
    """Means of all recordings of the parts' executions in `world`."""

    def means(part: PlanPart) -> Felt:
        return mean_recordings(_execute_part(world, part)[0])

    return [mean for each in shared_out(means, parts) for mean in each]


def _execute_part(world: Scene, part: PlanPart) -> tuple[Trace, World]:
    """Trace of a noise-free simulated robot that executes a part in `world`, and that as it is then.

    Raises:
        Interrupted: a signal came meanwhile.
    """
    from palpate.robots.owner import measured_arm
    from palpate.robots.simulated.robot import MujocoRobot

    plan, scene, q = part
    arm = measured_arm(scene.arm)
    robot = MujocoRobot(world.spec(), scene.pose_world_base, arm, substeps=REPLAY_SUBSTEPS, q=q)
    with interrupts() as signals, signals.raised():
        done = perform(plan, scene, robot, noiseless=True, tick_period=REPLAY_PERIOD)
    return done.trace, robot.world


def replay_of(
    plan: Plan, scene: Scene, trace: Trace, estimates: Collection[Estimate]
) -> Replay | None:
    """Execution in a given world of what is compared of a plan; None where nothing was recorded.

    Args:
        plan: executed.
        scene: that it was made for.
        trace: of its execution.
        estimates: what was measured, which later parts know.
    """
    nodes = [leaf.node for leaf in trace.leaves]
    if len(set(nodes)) < len(nodes):  # a node ran twice: no part of one plan covers that
        return partial(replay_parts, [PlanPart(plan, scene)])
    parts = list(_parts(plan, scene, trace, estimates))
    if not parts:
        return None

    def replay(world: Scene) -> Felt:
        means = replay_parts(parts, world)
        if len(parts) > 1 and len(means) < len(trace.recordings):
            return replay_parts([PlanPart(plan, scene)], world)  # a part depends on one before it
        return means

    return replay


def _parts(
    plan: Plan, scene: Scene, trace: Trace, estimates: Collection[Estimate]
) -> Iterator[PlanPart]:
    """Cut a plan into parts that each end with a recording and begin at a rest before the next."""
    leaves, recordings = trace.leaves, trace.recordings
    if not recordings:
        return
    opens = next((leaf.node for leaf in leaves if leaf.primitive == OPENS), "")
    certain = all(map(_is_certain, scene.bodies.values()))
    places = list(rests(leaves)) if certain else []
    first, ends, q = 0, 0.0, None
    for before, after in zip(recordings, [*recordings[1:], None], strict=True):
        start = leaves[first].start
        ends = max(ends, *_compared_interval(trace, before, start))
        begins = None
        if after is not None:
            earliest, _ = _compared_interval(trace, after, before.end)
            begins = max((i for i in places if ends <= leaves[i].start <= earliest), default=None)
            if begins is None:
                continue
        at = scene
        if first:
            at = _scene_at(scene, trace, start, estimates)
            q = np.mean(trace.samples.between(start - REST, start).q, axis=0)
        nodes = [leaf.node for leaf in leaves[first:begins] if leaf.start < ends]
        yield PlanPart(part_of(plan, [opens, *nodes]), at, q)
        first = begins or first


def _compared_interval(trace: Trace, recording: Recording, since: float) -> tuple[float, float]:
    """First and last robot time, s, of a recording, and of motions of the empty hand that it is compared with: those
    after `since` and before it, or else the first one after it; of all, where none is after `since`."""
    empty: list[LeafRun] = []
    if recording.buffer == FORCES:
        every = list(empty_motions(trace, recording))
        later = [leaf for leaf in every if leaf.start >= since] or every
        empty = [leaf for leaf in later if leaf.end <= recording.start] or later[:1]
    used = [recording, *empty]
    return min(one.start for one in used), max(one.end for one in used)


def _is_certain(body: Body) -> bool:
    """True if no touch corrects where the body is believed."""
    return body.covariance is None


def _scene_at(scene: Scene, trace: Trace, before: float, estimates: Collection[Estimate]) -> Scene:
    """The scene as it is known at robot time `before`, s."""
    state = SymbolicState(scene)
    for estimate in estimates:
        converted = trace.converted(estimate.parameter)
        if estimate.has_value and converted is not None and converted.end < before:
            state = state.learn_parameter(estimate.parameter, tuple(estimate.values.tolist()))
    return state.scene


def rests(leaves: Sequence[LeafRun]) -> Iterator[int]:
    """Indices of the motions before which the open hand is at rest in free air, and nothing was left elsewhere."""
    is_open = False
    for i, (leaf, after) in enumerate(pairwise(leaves), 1):
        now, then = leaf.context, after.context
        if now is None or then is None or now.activity in LASTING:
            return
        if now.holding is not None and then.holding is None and now.at != now.grasp:
            return
        if leaf.primitive in HANDS:
            is_open = leaf.primitive == OPENS
        still = now.activity == "still" and now.holding is None and leaf.end <= after.start
        if is_open and still and leaf.primitive == "MovePose" and after.primitive not in HANDS:
            yield i


# Build the digital twin, and validate it by executing the plan again in simulation.


def build_twin(made: Run, callbacks: RunCallbacks = SILENT) -> Run:
    """Write the estimates into the scene's MJCF. A scene detected in a picture is taken as the
    symbolic state has it at the end of the execution."""
    if made.trace_if_any is None:
        return made
    callbacks.progress("building the twin")
    scene = made.scene
    if made.seen and made.final_state is not None:
        scene = made.final_state.scene
    twin = build(scene, made.estimates, on_the_way=sizes_on_the_way(made, scene))
    return replace(made, scene=scene, finished=twin)


def sizes_on_the_way(made: Run, scene: Scene) -> list[Estimate]:
    """Sizes that nobody asked for, of objects of `scene` whose own are from a picture or marked unsure, from the
    grasps and touches of the run."""
    trace = made.trace_if_any
    asked = {parameter.object for parameter in made.plan.parameters if parameter.quantity == "size"}
    if trace is None:
        return []
    unsure = [body for body in scene.objects.values() if body.seen and body.name not in asked]
    found = [size_on_the_way(sound(trace), body) for body in unsure]
    return [size for size in found if size is not None]


@contextmanager
def touched_beside(made: Run, cell: Cell) -> Generator[Beside[Given] | None]:
    """Execute the plan in the scene as given, in parallel with the execution on the robot. Yield
    None if the twin will not be validated, or if a real robot needs the processor."""
    if made.settings.fast or made.seen or not cell.simulated:
        yield None
        return
    # Independent of any estimate, so it need not wait for them.
    with Beside(lambda: touched_as_given(made.plan, made.scene)) as given:
        yield given


def touch_twin(
    made: Run,
    planned_in: Scene,
    callbacks: RunCallbacks = SILENT,
    given: Beside[Given] | None = None,
) -> Run:
    """Validate the twin: execute the plan in it and in the scene as given, and compare both
    recordings with the run's own.

    Args:
        made: the run.
        planned_in: the scene that the planner knew.
        callbacks: progress.
        given: execution in the scene as given, from `touched_beside`; else it is executed here.
    """
    if made.finished is None:
        return made
    callbacks.progress("validating the twin in simulation")
    trace = made.trace_if_any
    if trace is None:
        return made
    trace = _of_plan(trace, made.plan)
    again = replay_of(made.plan, planned_in, trace, made.estimates)
    if again is None:
        return made
    # `given` executed the whole plan: comparable only if the robot executed the whole plan as well.
    whole = made.execution is not None and made.execution.status == "complete"
    beside = (lambda: given.result().felt) if given is not None and whole else None
    return replace(made, finished=touch(made.finished, made.scene, trace, again, beside))


def _of_plan(trace: Trace, plan: Plan) -> Trace:
    """The trace up to the first leaf that is none of the plan's: of a repetition, or of what was done after a
    failure."""
    nodes = {path for path, _ in plan.tree.walk()} if plan.tree is not None else set[str]()
    others = [leaf.start for leaf in trace.leaves if leaf.node not in nodes]
    return trace.until(min(others)) if others else trace
