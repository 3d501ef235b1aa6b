"""The sixth stage: the twin is written, and touched in simulation as the real things were."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from palpate.beside import Beside
from palpate.callbacks import SILENT, RunCallbacks
from palpate.cells.cell import Cell
from palpate.execution.build import part_of
from palpate.interrupt import interrupts
from palpate.planning.plan import Plan
from palpate.runs.run import Run
from palpate.scene.scene import Scene
from palpate.stages.executing import perform
from palpate.twin.twin import build_twin as build
from palpate.twin.twin import touch
from palpate.twin.validate import compared_until, restful

if TYPE_CHECKING:
    from mujoco import MjSpec

    from palpate.trace.samples import Trace


def build_twin(made: Run, callbacks: RunCallbacks = SILENT) -> Run:
    """From estimates to a twin of the scene as it was believed in the end."""
    if made.trace_if_any is None:
        return made
    callbacks.progress("building the twin")
    scene = made.scene
    if made.seen and made.final_state is not None:
        scene = made.final_state.scene
    twin = build(scene, made.estimates)
    return replace(made, scene=scene, finished=twin)


@contextmanager
def touched_beside(made: Run, cell: Cell) -> Generator[Beside[Trace] | None]:
    """The scene as it was given, touched while the real one is: nothing that is measured tells how. None
    where nothing is to be touched, or where a real robot needs the processor."""
    if made.settings.fast or made.seen or not cell.simulated:
        yield None
        return
    with Beside(lambda: _replay(made.scene, made.plan, restful(made.scene))) as given:
        yield given


def touch_twin(
    made: Run,
    planned_in: Scene,
    callbacks: RunCallbacks = SILENT,
    given: Beside[Trace] | None = None,
) -> Run:
    """The run with its twin touched in simulation, and the scene as it was given: the plan is executed
    again in both, as far as it is compared. `planned_in` is what its planner knew; `given`: from
    `touched_beside`."""
    if made.finished is None:
        return made
    callbacks.progress("touching the twin in simulation")
    trace = made.trace_if_any
    if trace is None:
        return made
    plan = _compared(made.plan, trace)
    if plan.tree is None:
        return made
    again = partial(_replay, planned_in, plan)
    # The whole plan has been executed in the scene as given: that is the same where it was here, too.
    whole = made.execution is not None and made.execution.status == "complete"
    beside = given.result if given is not None and whole else None
    return replace(made, finished=touch(made.finished, made.scene, trace, again, beside))


def _compared(plan: Plan, trace: Trace) -> Plan:
    """The part of the plan that is executed again."""
    until = compared_until(trace)
    begun = [leaf.node for leaf in trace.leaves if leaf.start < until]
    if len(set(begun)) != len(begun):  # it was planned again, or parts of it were repeated
        return plan
    return part_of(plan, begun)


def _replay(scene: Scene, plan: Plan, world: MjSpec) -> Trace:
    """Recording of a perfect robot that executes the plan in `world`.

    Raises:
        Interrupted: a signal came meanwhile.
    """
    from palpate.robots.owner.calibrated import as_measured
    from palpate.robots.simulated.robot import MujocoRobot

    robot = MujocoRobot(world, scene.pose_world_base, as_measured(scene.arm))
    with interrupts() as signals, signals.raised():
        return perform(plan, scene, robot).trace
