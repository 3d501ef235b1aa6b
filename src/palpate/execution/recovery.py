"""Recovery from an early stop, and repetition for narrower intervals."""

from __future__ import annotations

import logging
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

from palpate.common.errors import InputError, PalpateError
from palpate.common.parameter import Parameter
from palpate.estimation.quantities.estimators import estimate_all
from palpate.estimation.quantities.quantity import Effort
from palpate.estimation.quantities.within import Precision, Within, format_width
from palpate.planning.check.check import check
from palpate.planning.plan import Plan
from palpate.planning.symbolic.efforts import Efforts, site_of
from palpate.planning.symbolic.planner import assemble
from palpate.primitives.registry import Vocabulary, vocabulary
from palpate.primitives.state import SymbolicState
from palpate.robots.robot import Recoverable, Robot
from palpate.scene.load import rearrange, scene_with_measurements
from palpate.scene.scene import Scene
from palpate.trace.recording import Conversion, LeafRun
from palpate.trace.samples import Samples, Trace

if TYPE_CHECKING:
    from palpate.execution.runner import Execution


log = logging.getLogger(__name__)

OnFailure = Literal["stop", "skip", "replan"]
Runner = Callable[[Plan, Scene, Robot], "Execution"]
# Test of a further plan before it moves the robot, for example by a rehearsal.
MayRun = Callable[[Plan, Scene], bool]
# Question to a person, with the reason of a real robot's stop; True means continue.
Resume = Callable[[str], bool]
# Number of failures at one object after which it is left out, by policy.
ATTEMPTS = {"stop": 0, "skip": 1, "replan": 3}


def nobody(_: str) -> bool:
    """Answer without a person: a stopped robot does not continue."""
    return False


def anyway(_: Plan, __: Scene) -> bool:
    """Answer without a rehearsal: a checked plan may run."""
    return True


def recover(
    first: Execution,
    plan: Plan,
    scene: Scene,
    robot: Robot,
    policy: OnFailure,
    run: Runner,
    real: bool = False,
    may_resume: Resume = nobody,
    may_run: MayRun = anyway,
) -> Execution:
    """The execution joined with all further attempts that the policy and `may_run` allow.

    With a `real` robot, `may_resume` is asked after the robot stopped itself.
    """
    done, now, failures = first, plan, Counter[str]()
    attempts = ATTEMPTS[policy]
    for attempt in range(attempts * len(scene.bodies)):
        if not resumable(done, robot):
            break
        if real and (done.reflex or done.fault):
            confirmed_by = resume_note(done, robot, may_resume)
            if confirmed_by is None:
                break
            done = confirmed_by
        # Count the failure at its object, and leave out objects that failed too often.
        rest = remaining(plan.parameters, done.trace)
        name = failed_at(done.trace, now, scene) or (rest[0].object if rest else "")
        # The pose of an object that slipped out of the fingers is unknown: no further attempt.
        held = done.held
        lost = held is not None and (held.object, held.became) == (name, "lost")
        failures[name] += attempts if lost else 1
        rest = [wanted for wanted in rest if failures[wanted.object] < attempts]
        # Objects with failures come last, so that the others do not wait for them.
        rest.sort(key=lambda wanted: failures[wanted.object])
        try:
            # Plan for the remaining parameters from the believed poses at the stop.
            state = done.final_state
            around = rearrange(state.scene, state.elsewhere())
            again = replan(rest, around, f"{plan.planner}, {policy}")
            if again is None or not may_run(again, around):
                break
        except Exception as error:
            # A failed planning does not lose the result so far.
            log.warning(
                "no further attempt, planning it failed: %s: %s", type(error).__name__, error
            )
            break
        now = again
        done = join_executions(done, run(now, around, robot), f"replan[{attempt + 1}].")
    return done


def resumable(done: Execution, robot: Robot) -> bool:
    """True if a stopped run may be continued.

    Nothing is held, and the robot has no fault that only a person can judge.
    """
    if done.asked or done.status != "stopped" or done.final_state.holding is not None:
        return False
    # A fault that the robot itself reports can be cleared; implausible signals cannot.
    stopped = isinstance(robot, Recoverable) and robot.state.fault is not None
    return done.fault is None or stopped


def resume_note(done: Execution, robot: Robot, may_resume: Resume) -> Execution | None:
    """The execution with a person's confirmation as part of the reason.

    None without a confirmation, or if the robot cannot continue.
    """
    why = done.stopped_by or ""
    if not may_resume(why):
        log.warning("not taken up again by itself: see what the arm met, then run again")
        return None
    try:
        if isinstance(robot, Recoverable):
            robot.recover()
    except PalpateError as error:
        log.warning("it cannot go on: %s", error)
        return None
    return replace(done, stopped_by=confirmed_reason(why))


def confirmed_reason(why: str) -> str:
    """Reason of a stop, with the time at which a person let the robot continue."""
    word = f"{why} (a person let the robot go on at {time.strftime('%H:%M:%S')})"
    log.warning("%s", word)
    return word


def remaining(parameters: Sequence[Parameter], trace: Trace) -> list[Parameter]:
    """Parameters without a conversion so far; derived ones are recorded again completely."""
    # A conversion shows that the recordings of its parameter are complete.
    made = {Parameter(c.object, c.quantity) for c in trace.conversions}
    return [parameter for parameter in parameters if parameter not in made]


def failed_at(
    trace: Trace, plan: Plan, scene: Scene, words: Vocabulary | None = None
) -> str | None:
    """Object or surface of the last failed leaf in the trace, a leaf of `plan`."""
    failed = next((leaf for leaf in reversed(trace.leaves) if leaf.status == "FAILURE"), None)
    if failed is None or failed.context is None:
        return None
    # The held object comes first, else the subject of the motion's goal.
    if failed.context.holding:
        return failed.context.holding
    expression = _goal(failed, plan, scene, words or vocabulary()) or failed.context.at
    if not expression or expression in scene.symbols.configurations:
        return None
    return scene.symbols.subject(expression)


def _goal(leaf: LeafRun, plan: Plan, scene: Scene, words: Vocabulary) -> str | None:
    """Pose expression of a motion's goal."""
    nodes = dict(plan.tree.walk()) if plan.tree else {}
    node = nodes.get(leaf.node[leaf.node.find("tree") :])  # without the prefix of its attempt
    if node is None:
        return None
    try:
        return words.make(node.type, dict(node.args)).effects(SymbolicState(scene)).at
    except InputError:
        return None


def replan(parameters: Sequence[Parameter], scene: Scene, planner: str) -> Plan | None:
    """A checked plan for missing parameters in the current scene; None without one."""
    made = assemble(scene, parameters)
    if made.tree is None:
        return None
    why = "What is still missing, from where things stand now."
    plan = Plan(made.measured, made.tree, why, planner)
    return None if check(plan, scene) else plan


def join_executions(first: Execution, second: Execution, prefix: str) -> Execution:
    """Join two executions into one that ends as the second.

    Nodes of the second one get the `prefix`. The reason of the first one's stop becomes a setback.
    """
    a, b = first.trace, second.trace
    # Conversions refer to recordings, so they must follow the renaming.
    renamed = {r: replace(r, node=prefix + r.node) for r in b.recordings}
    conversions: list[Conversion] = []
    for conversion in b.conversions:
        recording = renamed.get(conversion.recording, conversion.recording)
        conversions.append(replace(conversion, recording=recording))
    # The reason of the first stop remains visible in the joined result.
    setback = () if first.stopped_by is None else (first.stopped_by,)
    trace = replace(
        b,
        samples=Samples.concatenate([a.samples, b.samples]),
        leaves=(*a.leaves, *(replace(leaf, node=prefix + leaf.node) for leaf in b.leaves)),
        recordings=(*a.recordings, *renamed.values()),
        conversions=(*a.conversions, *conversions),
    )
    # Beliefs of both: a body that was not touched again keeps its belief.
    final, before = second.final_state, first.final_state
    return replace(
        second,
        trace=trace,
        final_state=replace(final, beliefs={**before.beliefs, **final.beliefs}),
        setbacks=(*first.setbacks, *setback),
        actions=first.actions + second.actions,
        robot_seconds=first.robot_seconds + second.robot_seconds,
        wall_seconds=first.wall_seconds + second.wall_seconds,
    )


# Repetition for `--within`: parameters with too wide intervals are measured again by the same robot,
# until the intervals are narrow enough or at the floor that no repetition lowers.


MAX_ROUNDS = 5  # Largest number of rounds of repetition
# Largest number of repetitions in one round, since the noise of the first round is uncertain.
MOST_TIMES = 4
# s of robot time of further rounds after which no new round begins. In a third of a drift's time
# constant (300 s, `robots/simulated/noise/lab.yaml`) the arm changes noticeably. The cost of an
# estimate grows with the cube of its data. A round of twelve grasps of a hammer takes 115 s.
LONGEST = 100.0
# Largest ratio of an interval to the one two rounds before, for another round to follow. The noise
# level is learned again after each round, so that one round alone may widen an interval.
FUTILE = 0.98

Lacking = dict[Parameter, Precision]  # Parameter with a wider interval than requested


def repeat(
    first: Execution,
    plan: Plan,
    scene: Scene,
    robot: Robot,
    within: Within,
    run: Runner,
    say: Callable[[str], None],
    may_run: MayRun = anyway,
) -> Execution:
    """The execution joined with all further rounds that `within` requires and `may_run` allows.

    `say` shows the purpose of each round.
    """
    done = first
    widths: dict[Parameter, list[float]] = {}
    asked = [parameter for parameter in plan.parameters if within.of(parameter) is not None]
    so_far = Counter(asked)
    for count in range(1, MAX_ROUNDS + 1):
        took = done.robot_seconds - first.robot_seconds
        if not asked or done.status != "complete" or took > LONGEST:
            break
        lacking: Lacking = {}
        for parameter, precision in too_wide(asked, done, scene, within):
            past = widths.setdefault(parameter, [])
            # Repeat only parameters whose interval the last two rounds narrowed, if there were two.
            if len(past) < 2 or precision.reached < FUTILE * past[-2]:
                lacking[parameter] = precision
            past.append(precision.reached)
        asked = list(lacking)
        # Slides of every other round begin on the opposite side: a dragged object lags behind the hand.
        efforts = efforts_for(lacking, scene, done, so_far)
        again = plan_again(efforts, done, plan.planner, mirrored=count % 2 == 1)
        if again is None or not may_run(*again):
            break
        for parameter, effort in efforts.items():
            so_far[parameter] += effort.times
        say(f"measuring again, {widths_in_words(lacking, scene)}")
        done = join_executions(done, run(*again, robot), f"repeat[{count}].")
    return done


def too_wide(
    asked: Sequence[Parameter], done: Execution, scene: Scene, within: Within
) -> Iterator[tuple[Parameter, Precision]]:
    """Parameters whose interval further repetition would narrow.

    Contradicted parameters, and parameters that are not identified, are left out.
    """
    for estimate in estimate_all(
        asked, done.trace, scene_with_measurements(scene, done.trace).bodies
    ):
        # Only an interval that is too wide for lack of rounds can be narrowed.
        precision = within.precision(estimate)
        if precision is None or estimate.contradiction or not estimate.has_value:
            continue
        if precision.outcome == "rounds used up":
            yield estimate.parameter, precision


def efforts_for(
    lacking: Lacking, scene: Scene, done: Execution, so_far: Counter[Parameter]
) -> dict[Parameter, Effort]:
    """Effort for each parameter.

    Its quantity predicts it from the arm's noise in the trace. Otherwise it is extrapolated from the
    repetitions `so_far`.
    """
    found: dict[Parameter, Effort] = {}
    for parameter, precision in lacking.items():
        # A quantity that models its precision predicts the effort; else scale the repetitions.
        site, effort = site_of(scene, parameter), None
        if site is not None:
            quantity = scene.catalogue[parameter.quantity]
            effort = quantity.effort(site, precision.further_std, done.trace)
        times = min(precision.further(so_far[parameter]), MOST_TIMES)
        found[parameter] = effort or Effort(times=times)
    return found


def plan_again(
    efforts: Efforts, done: Execution, planner: str, mirrored: bool
) -> tuple[Plan, Scene] | None:
    """A checked plan for the parameters in the current scene, and the scene.

    `mirrored` is true every other time. None without a plan, or if planning fails.
    """
    if not efforts:
        return None
    try:
        # Plan from the believed poses at the end of the last round.
        around = rearrange(done.final_state.scene, done.final_state.elsewhere())
        made = assemble(around, efforts, None, efforts, mirrored)
        if made.tree is None:
            return None
        why = "Measured again: the intervals are wider than asked."
        plan = Plan(made.measured, made.tree, why, f"{planner}, again")
        findings = check(plan, around, remeasure=True, repeated=True)
        return None if findings else (plan, around)
    except Exception as error:
        log.warning("nothing is measured again, planning it failed: %s", error)
        return None


def widths_in_words(lacking: Lacking, scene: Scene) -> str:
    """List as text: `bottle.mass: ± 3.1 g where ± 1 g is asked`."""
    said: list[str] = []
    for parameter, precision in lacking.items():
        unit = scene.catalogue[parameter.quantity].unit
        reached, asked = format_width(precision.reached, unit), format_width(precision.asked, unit)
        said.append(f"{parameter}: ± {reached} where ± {asked} is asked")
    return ", ".join(said)
