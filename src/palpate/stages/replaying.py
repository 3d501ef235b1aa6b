"""Execution of a plan again in a world without noise, to compare what is felt: in parts, by several processes.

A part begins where the recorded run was at rest, with an empty hand and every object where the scene has it, and ends
with its last recording: what comes after that, setting an object down, is left out. Of what comes before it needs the
heights that were measured, which are the run's own. Means of forces at rest move by less than 0.08 N (15 boxes in 15
parts; rms 0.02 N), those of a slide by 0.1 N where the run's height of a surface is 20 micrometres from the replay's
own.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from palpate.beside import shared_out
from palpate.estimation.estimate import Estimate
from palpate.geometry.pose import Array
from palpate.interrupt import interrupts
from palpate.mjcf.body import Body
from palpate.planning.plan import Plan, part_of
from palpate.scene.scene import Scene
from palpate.stages.executing import perform
from palpate.trace.recording import Activity, LeafRun, Recording
from palpate.trace.samples import FORCES, Trace
from palpate.twin.validate import REST, Felt, Replay, empty_motions, felt
from palpate.vocabulary.state import SymbolicState

if TYPE_CHECKING:
    from palpate.pictures.film import Shot
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


class Part(NamedTuple):
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
    from palpate.pictures.film import Footage, Shot

    trace, world = _executed(scene, Part(plan, scene))
    return Given(felt(trace), Shot.of(Footage(world.model, tuple(world.frames))))


def replayed(parts: Sequence[Part], world: Scene) -> Felt:
    """Means of all recordings of the parts' executions in `world`."""

    def means(part: Part) -> Felt:
        return felt(_executed(world, part)[0])

    return [mean for each in shared_out(means, parts) for mean in each]


def _executed(world: Scene, part: Part) -> tuple[Trace, World]:
    """Trace of a noise-free simulated robot that executes a part in `world`, and that as it is then.

    Raises:
        Interrupted: a signal came meanwhile.
    """
    from palpate.robots.owner.arm import as_measured
    from palpate.robots.simulated.robot import MujocoRobot

    plan, scene, q = part
    arm = as_measured(scene.arm)
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
        return partial(replayed, [Part(plan, scene)])
    parts = list(_parts(plan, scene, trace, estimates))
    if not parts:
        return None

    def again(world: Scene) -> Felt:
        means = replayed(parts, world)
        if len(parts) > 1 and len(means) < len(trace.recordings):
            return replayed([Part(plan, scene)], world)  # a part depends on one before it
        return means

    return again


def _parts(
    plan: Plan, scene: Scene, trace: Trace, estimates: Collection[Estimate]
) -> Iterator[Part]:
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
        ends = max(ends, *_compared(trace, before, start))
        begins = None
        if after is not None:
            earliest, _ = _compared(trace, after, before.end)
            begins = max((i for i in places if ends <= leaves[i].start <= earliest), default=None)
            if begins is None:
                continue
        at = scene
        if first:
            at = _as_measured(scene, trace, start, estimates)
            q = np.mean(trace.samples.between(start - REST, start).q, axis=0)
        nodes = [leaf.node for leaf in leaves[first:begins] if leaf.start < ends]
        yield Part(part_of(plan, [opens, *nodes]), at, q)
        first = begins or first


def _compared(trace: Trace, recording: Recording, since: float) -> tuple[float, float]:
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


def _as_measured(
    scene: Scene, trace: Trace, before: float, estimates: Collection[Estimate]
) -> Scene:
    """The scene as it is known at robot time `before`, s."""
    state = SymbolicState(scene)
    for estimate in estimates:
        converted = trace.converted(estimate.parameter)
        if estimate.has_value and converted is not None and converted.end < before:
            state = state.learned(estimate.parameter, tuple(estimate.values.tolist()))
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
