"""Recovery from an early stop: none, continuing without the failed part, or planning again.

The tree itself only has Sequence and Parallel, so recovery is outside it: after the arm has stopped and
put down the held object, the missing parameters are planned again for the present cell, and that plan is
run.

- `stop`: the run ends.
- `skip`: the object at which it failed is left out, the others are measured.
- `replan`: everything missing is planned again; an object at which it failed comes last, and is left out
  after `ATTEMPTS` failures, or after the first if it slipped out of the fingers.

A run that a person stopped, that still holds an object, or whose robot has a fault is never continued.
Nor is a real robot that stopped itself, or was stopped by its user stop, unless a person confirms.
"""

from __future__ import annotations

import logging
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

from palpate.errors import InputError, PalpateError
from palpate.parameter import Parameter
from palpate.planning.check.check import check
from palpate.planning.plan import Plan
from palpate.planning.symbolic.planner import assemble
from palpate.robots.robot import Recoverable, Robot
from palpate.scene.load import rearranged
from palpate.scene.scene import Scene
from palpate.trace.recording import Conversion, LeafRun
from palpate.trace.samples import Samples, Trace
from palpate.vocabulary.registry import Vocabulary, vocabulary
from palpate.vocabulary.state import SymbolicState

if TYPE_CHECKING:
    from palpate.execution.runner import Execution

log = logging.getLogger(__name__)

OnFailure = Literal["stop", "skip", "replan"]
Runner = Callable[[Plan, Scene, Robot], "Execution"]
Resume = Callable[[str], bool]
"""Question to a person, with the reason of a real robot's stop: True to continue."""
ATTEMPTS = {"stop": 0, "skip": 1, "replan": 3}
"""Failures at one object after which it is left out, by policy."""


def nobody(_: str) -> bool:
    """Answer without a person: a stopped robot does not continue."""
    return False


def recover(
    first: Execution,
    plan: Plan,
    scene: Scene,
    robot: Robot,
    policy: OnFailure,
    run: Runner,
    real: bool = False,
    may_resume: Resume = nobody,
) -> Execution:
    """The execution joined with all further attempts that the policy allows; `real`: a real robot, for
    which `may_resume` is asked after it stopped itself."""
    done, now, failures = first, plan, Counter[str]()
    attempts = ATTEMPTS[policy]
    for attempt in range(attempts * len(scene.bodies)):
        if not resumable(done, robot):
            break
        if real and (done.reflex or done.fault):
            confirmed_by = resumed(done, robot, may_resume)
            if confirmed_by is None:
                break
            done = confirmed_by
        rest = remaining(plan.parameters, done.trace)
        name = failed_at(done.trace, now, scene) or (rest[0].object if rest else "")
        # The pose of an object that slipped out of the fingers is unknown: no further attempt.
        held = done.held
        lost = held is not None and (held.object, held.became) == (name, "lost")
        failures[name] += attempts if lost else 1
        rest = [wanted for wanted in rest if failures[wanted.object] < attempts]
        # Where it failed comes last: the others do not wait for it.
        rest.sort(key=lambda wanted: failures[wanted.object])
        try:
            state = done.final_state
            around = rearranged(state.scene, state.elsewhere())
            again = replan(rest, around, f"{plan.planner}, {policy}")
        except Exception as error:
            # A failed planning does not lose the result so far.
            log.warning(
                "no further attempt, planning it failed: %s: %s", type(error).__name__, error
            )
            break
        if again is None:
            break
        now = again
        done = joined(done, run(now, around, robot), f"replan[{attempt + 1}].")
    return done


def resumable(done: Execution, robot: Robot) -> bool:
    """True if a stopped run may be continued: nothing is held, and the robot has no fault that only
    a person can judge."""
    if done.asked or done.status != "stopped" or done.final_state.holding is not None:
        return False
    # A fault that the robot itself reports can be cleared; implausible signals cannot.
    stopped = isinstance(robot, Recoverable) and robot.state.fault is not None
    return done.fault is None or stopped


def resumed(done: Execution, robot: Robot, may_resume: Resume) -> Execution | None:
    """The execution with a person's confirmation as part of the reason; None without one, or where
    the robot cannot continue."""
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
    return replace(done, stopped_by=confirmed(why))


def confirmed(why: str) -> str:
    """Reason of a stop, with the time at which a person let the robot continue."""
    word = f"{why} (a person let the robot go on at {time.strftime('%H:%M:%S')})"
    log.warning("%s", word)
    return word


def remaining(parameters: Sequence[Parameter], trace: Trace) -> list[Parameter]:
    """Parameters without a conversion so far; derived ones are recorded again completely."""
    made = {Parameter(c.object, c.quantity) for c in trace.conversions}
    return [parameter for parameter in parameters if parameter not in made]


def failed_at(
    trace: Trace, plan: Plan, scene: Scene, words: Vocabulary | None = None
) -> str | None:
    """Object or surface of the last failed leaf in the trace, a leaf of `plan`."""
    failed = next((leaf for leaf in reversed(trace.leaves) if leaf.status == "FAILURE"), None)
    if failed is None or failed.context is None:
        return None
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
    """A checked plan for missing parameters in the present scene; None when there is none."""
    made = assemble(scene, parameters)
    if made.tree is None:
        return None
    why = "What is still missing, from where things stand now."
    plan = Plan(made.measured, made.tree, why, planner)
    return None if check(plan, scene) else plan


def joined(first: Execution, second: Execution, prefix: str) -> Execution:
    """Both executions as one, which ends as the second, whose nodes get the `prefix`, with the reason
    of the first one's stop among its setbacks."""
    a, b = first.trace, second.trace
    renamed = {r: replace(r, node=prefix + r.node) for r in b.recordings}
    conversions: list[Conversion] = []
    for conversion in b.conversions:
        recording = renamed.get(conversion.recording, conversion.recording)
        conversions.append(replace(conversion, recording=recording))
    setback = () if first.stopped_by is None else (first.stopped_by,)
    trace = replace(
        b,
        samples=Samples.concatenate([a.samples, b.samples]),
        leaves=(*a.leaves, *(replace(leaf, node=prefix + leaf.node) for leaf in b.leaves)),
        recordings=(*a.recordings, *renamed.values()),
        conversions=(*a.conversions, *conversions),
    )
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
