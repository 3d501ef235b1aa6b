"""What the stages of the pipeline are made of: whom the settings name as planner and as cell, and what is
asked of them.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from palpate.cells.cell import Cell, Close
from palpate.cells.registry import drivers
from palpate.errors import InputError, PalpateError, PlanRejected, Stopped, Unavailable
from palpate.estimation.estimate import Estimate
from palpate.execution.part import part_of
from palpate.execution.recovery import OnFailure, Resume, confirmed, nobody
from palpate.geometry.pose import Pose
from palpate.interrupt import interrupts
from palpate.parameter import Parameter
from palpate.planning.check.check import Finding, check
from palpate.planning.plan import Plan
from palpate.planning.planner import Observant, Planner, PlannerSettings
from palpate.planning.registry import planners
from palpate.planning.symbolic.planner import requested
from palpate.quantities.estimators import estimate_all, failed
from palpate.quantities.precision.within import Within
from palpate.robots.owner.registered import require_same
from palpate.robots.robot import Recoverable, Robot
from palpate.runs.run import Ending, Run
from palpate.scene.load import parse_scene
from palpate.scene.pictured.detected import DetectedScene, SceneBuilder
from palpate.scene.poses import Poses, read_poses, seen_by
from palpate.scene.scene import Scene
from palpate.settings import Settings, noise_told
from palpate.twin.held_out import HeldOut, held_out, with_tests
from palpate.twin.twin import touch
from palpate.twin.validate import compared_until

if TYPE_CHECKING:
    from mujoco import MjSpec

    from palpate.execution.runner import Execution, Keep, Observer
    from palpate.pictures.footage import Footage
    from palpate.trace.samples import Trace

MADE_UP = "Simulated: the true value was drawn from priors, and is that of no real thing."
log = logging.getLogger(__name__)


def ask_planner(settings: Settings, scene: Scene | None, planner: Planner | None) -> Run:
    """The answer of `planner`, else of the one that the settings name, and what the check finds
    wrong with it.

    Raises:
        InputError: bad input. Unavailable: the provider.
    """
    if scene is not None:
        settings.within.check(scene.bodies)
    poses = read_poses(settings.poses) if settings.poses else Poses()
    base = Pose.of((0.0, 0.0, 0.0)) if scene is None else scene.pose_world_base
    poses = seen_by(poses, settings.described_arm(), base)
    planner = planner or _planner(settings, poses)
    pictures = _pictures(planner, settings, scene, poses)
    answer = _answer(planner, settings, scene, pictures)
    seen, conversation = None, None
    if isinstance(planner, Observant):
        seen, conversation = planner.seen, planner.conversation
    scene = scene or _scene_of(answer, seen)
    answer = _read_otherwise(settings, answer, scene)
    # A model's answers are checked one by one, until one passes; nobody else checks its own plan.
    checked = conversation is not None
    findings = () if checked else _findings(settings, answer, scene)
    return Run(settings, scene, answer, findings, conversation, seen, next(iter(pictures), None))


def connected(settings: Settings, scene: Scene | None) -> Cell:
    """The cell of the real robot that the settings name.

    Raises:
        InputError: no such URL. Unavailable: no driver for it, or no answer.
    """
    assert settings.robot is not None
    return drivers().connect(settings.robot, scene)


def cell_for(settings: Settings, scene: Scene | None, seen: bool = False) -> Cell:
    """The cell that the settings name; `seen`: the scene was made of a picture.

    Raises:
        InputError: world and scene do not match, or what was measured is another arm's. Unavailable:
            no driver for the robot.
    """
    from palpate.cells.simulated import simulated_cell

    simulated = (noise_told(settings.noise), settings.seed) if settings.robot is None else None
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


def pictures_of(settings: Settings, scene: Scene | None, poses: Poses) -> tuple[bytes, ...]:
    """The workspace as PNGs: seen by the camera of `poses` if it has one, then, with a scene whose
    names can be shown, from nearer; none where there is nothing to look at or no way to look."""
    if scene is None and settings.world is None and settings.robot is None:
        return ()
    cell = cell_for(settings, scene)
    taken = [cell.picture(poses.camera)]
    if scene is not None and isinstance(cell, Close):
        taken.append(cell.closer())
    return tuple(picture for picture in taken if picture is not None)


def robot_of(cell: Cell, may_resume: Resume = nobody) -> tuple[Robot, tuple[str, ...]]:
    """The cell's robot, and what it had to get over: where it was stopped before, `may_resume` is asked
    whether it may go on.

    Raises:
        InputError: the workplace cannot be used. Unavailable: the robot is out of reach.
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


def perform(
    plan: Plan,
    scene: Scene,
    robot: Robot,
    observer: Observer | None = None,
    on_failure: OnFailure = "stop",
    keep: Keep | None = None,
    within: Within | None = None,
    say: Callable[[str], None] = print,
    real: bool = False,
    may_resume: Resume = nobody,
) -> Execution:
    """Run the tree on the robot, go on after a failure as far as the policy allows, and measure
    again what is wider than `within` asks, of which `say` is told; the robot is let go in any case.
    `keep` writes down what it senses meanwhile. `real`: something real moves, and where it was stopped
    `may_resume` is asked."""
    from palpate.execution.recovery import recover
    from palpate.execution.repetition import repeat
    from palpate.execution.runner import run as run_tree

    attempt = partial(run_tree, observer=observer, keep=keep)
    try:
        first = attempt(plan, scene, robot)
        done = recover(first, plan, scene, robot, on_failure, attempt, real, may_resume)
        if within:
            done = repeat(done, plan, scene, robot, within, attempt, say)
        return done
    finally:
        _let_go(robot)


def _let_go(robot: Robot) -> None:
    """What was measured outlives a robot that cannot be closed."""
    try:
        robot.close()
    except Exception as error:
        log.warning("the robot was not closed: %s: %s", type(error).__name__, error)


def footage_of(cell: Cell) -> Footage | None:
    """What the cell's camera saw, None where it fails."""
    try:
        return cell.footage()
    except Exception as error:
        log.warning("there is no film: %s: %s", type(error).__name__, error)
        return None


def estimate_of(made: Run, parameter: Parameter) -> Estimate:
    """The estimate of a parameter from the run's trace, whatever goes wrong on the way."""
    if made.trace is None:
        return failed(parameter, "Nothing was recorded.")
    try:
        found = estimate_all([parameter], made.trace, made.scene.bodies)[0]
        return _told(made, found)
    except PalpateError as error:
        return failed(parameter, f"There is no estimator: {error}.")


def _told(made: Run, estimate: Estimate) -> Estimate:
    """The estimate, which says what it is not: in the twin, too, where nothing else does."""
    estimate = made.settings.within.told(estimate)
    if not made.drawn:
        return estimate
    return replace(estimate, method=f"{estimate.method} {MADE_UP}".lstrip())


def judged(made: Run, choice: Mapping[str, str] | None = None) -> Run:
    """The run with its estimates judged on motions that they were not fitted to, made again by the
    estimators that `choice` names."""
    if made.trace is None:
        return made
    try:
        held = held_out(made.scene, made.trace, made.estimates, choice)
    except Exception as error:
        reason = f"nothing was held out: {type(error).__name__}: {error}"
        return replace(made, held_out=HeldOut((), (reason,)))
    if held is None:
        return made
    return replace(made, held_out=held, estimates=with_tests(made.estimates, held))


def estimates_anew(made: Run, choice: Mapping[str, str]) -> Run:
    """The run with all estimates made anew, with the estimators that `choice` names by quantity.

    Raises:
        InputError: it has no trace, another version recorded it, or there is no such estimator.
    """
    if made.folder is not None:
        from palpate.runs.read import require_own_version

        require_own_version(made.folder)
    trace = made.trace
    if trace is None:
        where = "this run" if made.folder is None else f"'{made.folder}'"
        raise InputError(f"{where} has no trace to make estimates of: nothing was executed")
    found = estimate_all(made.plan.parameters, trace, made.scene.bodies, choice)
    told = tuple(_told(made, estimate) for estimate in found)
    again = replace(made, recorded=trace, estimates=told, held_out=None, twin=None)
    return judged(again, choice)


def truths(made: Run, cell: Cell) -> dict[Parameter, tuple[float, ...]]:
    """What is so, as far as the cell knows; asked when the estimates are made, never before."""
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


def cut_off(made: Run) -> Run:
    """A run whose process ended while it was executing, with the trace as far as that was written
    down."""
    trace = _readable_trace(made)
    leaves = trace.leaves if trace is not None else ()
    seconds = 0.0
    if trace is not None and len(trace.samples):
        seconds = float(trace.t[-1] - trace.t[0])
    ended_well = sum(leaf.status == "SUCCESS" for leaf in leaves) == made.plan.actions
    ending = Ending(
        "complete" if ended_well else "stopped",
        None if ended_well else "the process ended while the plan was executed",
        len(leaves),
        seconds,
        0.0,
    )
    return replace(made, execution=ending, recorded=trace)


def _readable_trace(made: Run) -> Trace | None:
    try:
        return made.trace
    except InputError:
        return None


def touched(made: Run, planned_in: Scene) -> Run:
    """The run with its twin touched in simulation, and the scene as it was given: the plan is executed
    again in both, as far as it is compared. `planned_in` is what its planner knew."""
    trace, twin = made.trace, made.twin
    if trace is None or twin is None:
        return made
    plan = made.plan
    until = compared_until(trace)
    begun = [leaf.node for leaf in trace.leaves if leaf.start < until]
    if len(set(begun)) == len(begun):  # else it was planned again, or parts of it were repeated
        plan = part_of(plan, begun)
    if plan.tree is None:
        return made
    again = partial(replay, planned_in, plan)
    return replace(made, twin=touch(twin, made.scene, trace, again))


def replay(scene: Scene, plan: Plan, world: MjSpec) -> Trace:
    """What a perfect robot feels when the plan is executed in `world`.

    Raises:
        Interrupted: a signal came meanwhile.
    """
    from palpate.robots.owner.calibrated import as_measured
    from palpate.robots.simulated.robot import MujocoRobot

    robot = MujocoRobot(world, scene.pose_world_base, as_measured(scene.arm))
    with interrupts() as signals, signals.raised():
        return perform(plan, scene, robot).trace


def _planner(settings: Settings, poses: Poses) -> Planner:
    builder = SceneBuilder(poses, settings.described_arm())
    told = PlannerSettings(settings.remeasure, settings.model_settings, builder, settings.within)
    return planners().make(settings.planner, told)


def _pictures(
    planner: Planner, settings: Settings, scene: Scene | None, poses: Poses
) -> tuple[bytes, ...]:
    """The workspace as PNGs, where it is to be looked at and no image was given."""
    looks = scene is None or (isinstance(planner, Observant) and planner.looks)
    if settings.images or not looks or "image" in settings.model_settings.without:
        return ()
    return pictures_of(settings, scene, poses)


def _answer(
    planner: Planner, settings: Settings, scene: Scene | None, pictures: tuple[bytes, ...]
) -> Plan:
    """The planner's answer; a rejection is a plan without a tree that says why."""
    from palpate.cells.view import image_files

    with image_files(settings.images, pictures) as images:
        try:
            return planner.plan(settings.request, scene, images)
        except PlanRejected as rejection:
            return Plan((), None, str(rejection), settings.planner)


def _scene_of(answer: Plan, seen: DetectedScene | None) -> Scene:
    """What a model saw; a rejection without D is about an empty scene."""
    if seen is not None:
        return seen.scene()
    if answer.tree is not None:
        raise InputError(
            "the plan comes without the objects of its scene: give the MJCF with scene=D.xml"
        )
    return parse_scene("<mujoco><worldbody/></mujoco>")


def _findings(settings: Settings, answer: Plan, scene: Scene) -> tuple[Finding, ...]:
    """What the check says against a plan."""
    if answer.tree is None:
        return ()
    remeasure = settings.remeasure or settings.planner == "exhaustive"
    return check(answer, scene, remeasure=remeasure)


def _read_otherwise(settings: Settings, answer: Plan, scene: Scene) -> Plan:
    """The plan with a note where the words of the request are read as asking for something else
    than it measures. What they mean is for whoever wrote the plan to say."""
    own = settings.planner in ("symbolic", "exhaustive")
    if own or settings.request is None or "text" in settings.model_settings.without:
        return answer
    wanted = requested(settings.request, scene, settings.remeasure)
    if answer.tree is None or wanted is None or set(wanted) == set(answer.parameters):
        return answer
    asked = ", ".join(str(parameter) for parameter in wanted)
    note = (
        f"By its words the request asks for {asked}; the plan measures what its author took it for."
    )
    return replace(answer, notes=(*answer.notes, note))
