"""Build the digital twin, and validate it by executing the plan again in simulation."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from palpate.beside import Beside
from palpate.callbacks import SILENT, RunCallbacks
from palpate.cells.cell import Cell
from palpate.estimation.estimate import Estimate
from palpate.interrupt import interrupts
from palpate.planning.plan import Plan, part_of
from palpate.quantities.size import size_on_the_way
from palpate.runs.run import Run
from palpate.scene.scene import Scene
from palpate.stages.executing import perform
from palpate.trace.soundness import sound
from palpate.twin.twin import build_twin as build
from palpate.twin.twin import touch
from palpate.twin.validate import compared_until

if TYPE_CHECKING:
    from mujoco import MjSpec

    from palpate.trace.samples import Trace

REPLAY_PERIOD = 0.04
"""s between two ticks of an execution that is compared only in the means of its recordings: as long as the simulated
arm goes on without new feed-forward torques. Residuals move by less than 6 mN and 0.3 micrometres (bottle,
hammer, drawer), in a seventh to a fifth less time than at 0.02 s."""
REPLAY_SUBSTEPS = 1
"""Physics steps in a control cycle of it: of 1 ms, half MuJoCo's default, and twice those of an execution. Residuals of
1 to 2 N move by 1 to 4 mN (drawer: 16 mN), in a quarter to a third less time."""


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
def touched_beside(made: Run, cell: Cell) -> Generator[Beside[Trace] | None]:
    """Execute the plan in the scene as given, in parallel with the execution on the robot. Yield
    None if the twin will not be validated, or if a real robot needs the processor."""
    if made.settings.fast or made.seen or not cell.simulated:
        yield None
        return
    # Independent of any estimate, so it need not wait for them.
    with Beside(lambda: _replay(made.scene, made.plan, made.scene.spec())) as given:
        yield given


def touch_twin(
    made: Run,
    planned_in: Scene,
    callbacks: RunCallbacks = SILENT,
    given: Beside[Trace] | None = None,
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

    # Only the part of the plan that is compared is executed again.
    plan, until = made.plan, compared_until(trace)
    begun = [leaf.node for leaf in trace.leaves if leaf.start < until]
    replanned = len(set(begun)) != len(begun)  # a node ran twice: no part of one plan covers that
    if not replanned:
        plan = part_of(plan, begun)
    if plan.tree is None:
        return made

    again = partial(_replay, planned_in, plan)
    # `given` executed the whole plan: comparable only if the robot executed the whole plan as well.
    whole = made.execution is not None and made.execution.status == "complete"
    beside = given.result if given is not None and whole else None
    return replace(made, finished=touch(made.finished, made.scene, trace, again, beside))


def _replay(scene: Scene, plan: Plan, world: MjSpec) -> Trace:
    """Trace of a noise-free simulated robot that executes the plan in `world`.

    Raises:
        Interrupted: a signal came meanwhile.
    """
    from palpate.robots.owner.arm import as_measured
    from palpate.robots.simulated.robot import MujocoRobot

    arm = as_measured(scene.arm)
    robot = MujocoRobot(world, scene.pose_world_base, arm, substeps=REPLAY_SUBSTEPS)
    with interrupts() as signals, signals.raised():
        return perform(plan, scene, robot, noiseless=True, tick_period=REPLAY_PERIOD).trace
