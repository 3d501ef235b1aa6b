"""Build the digital twin, and validate it by executing the plan again in simulation."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import replace

from palpate.beside import Beside
from palpate.callbacks import SILENT, RunCallbacks
from palpate.cells.cell import Cell
from palpate.estimation.estimate import Estimate
from palpate.planning.plan import Plan
from palpate.quantities.size import size_on_the_way
from palpate.runs.run import Run
from palpate.scene.scene import Scene
from palpate.stages.replaying import Given, replay_of, touched_as_given
from palpate.trace.samples import Trace
from palpate.trace.soundness import sound
from palpate.twin.twin import build_twin as build
from palpate.twin.twin import touch


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
