"""Recovery from an early stop: none, continuing without the failed part, or planning again.

The tree itself only knows Sequence and Parallel, so recovery is outside it: the arm has stopped and
put down what it held, and what is still missing is planned again, from where things stand now, and
run on.

- `stop`: the run is over.
- `skip`: the object at which it failed is left alone, the rest is measured.
- `replan`: everything still missing is planned again; an object at which it failed comes last, is left
  alone after `ATTEMPTS` failures, and at once when it slipped out of the fingers.

A run that somebody stopped, that still holds an object, or whose robot cannot be believed is never
taken up again. Nor is a real robot that stopped itself, or was stopped by its user stop, unless a person
has seen what it met, and says so.
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

Runner = Callable[[Plan, Scene, Robot], "Execution"]
Resume = Callable[[str], bool]
"""Told what stopped a real robot; whether a person has seen to it, and lets it go on."""
ATTEMPTS = {"stop": 0, "skip": 1, "replan": 3}
"""Failures at one object after which it is left alone, by policy."""


def nobody(_: str) -> bool:
    """No person is there to let a stopped robot go on."""
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
    """The execution with all further attempts that the policy allows joined to it; `real`: something
    real moves, and where it was stopped `may_resume` is asked."""
    done, now, failures = first, plan, Counter[str]()
    attempts = ATTEMPTS[policy]
    for attempt in range(attempts * len(scene.bodies)):
        if not resumable(done, robot):
            break
        if real and (done.reflex or done.fault):
            let = let_go_on(done, robot, may_resume)
            if let is None:
                break
            done = let
        rest = remaining(plan.parameters, done.trace)
        name = failed_at(done.trace, now, scene) or (rest[0].object if rest else "")
        failures[name] += attempts if _lost(done, name) else 1
        rest = [wanted for wanted in rest if failures[wanted.object] < attempts]
        # Where it failed comes last: the others do not wait for it.
        rest.sort(key=lambda wanted: failures[wanted.object])
        again = _planned_again(rest, done, f"{plan.planner}, {policy}")
        if again is None:
            break
        now, around = again
        done = joined(done, run(now, around, robot), f"replan[{attempt + 1}].")
    return done


def _lost(done: Execution, name: str) -> bool:
    """True when the object slipped out of the fingers: its pose is unknown."""
    return done.held is not None and (done.held.object, done.held.became) == (name, "lost")


def _planned_again(
    rest: Sequence[Parameter], done: Execution, planner: str
) -> tuple[Plan, Scene] | None:
    """See `replan`; what was executed outlives a planning that fails."""
    try:
        return replan(
            rest, rearranged(done.final_state.scene, done.final_state.not_restored()), planner
        )
    except Exception as error:
        log.warning("no further attempt, planning it failed: %s: %s", type(error).__name__, error)
        return None


def resumable(done: Execution, robot: Robot) -> bool:
    """True if a stopped run left a cell in which to go on, and a robot that can be believed."""
    if done.asked or done.status != "stopped" or done.final_state.holding is not None:
        return False
    # What the robot itself says stopped it can be seen to; signals without sense cannot.
    stopped = isinstance(robot, Recoverable) and robot.state.fault is not None
    return done.fault is None or stopped


def let_go_on(done: Execution, robot: Robot, may_resume: Resume) -> Execution | None:
    """The execution with a word on who let it go on; None where nobody does, or the robot cannot."""
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
    """Reason of a stop, with the time at which a person let the robot go on."""
    word = f"{why} (a person let the robot go on at {time.strftime('%H:%M:%S')})"
    log.warning("%s", word)
    return word


def remaining(parameters: Sequence[Parameter], trace: Trace) -> list[Parameter]:
    """Parameters without a conversion so far; derived ones are recorded again as a whole."""
    made = {Parameter(c.object, c.quantity) for c in trace.conversions}
    return [parameter for parameter in parameters if parameter not in made]


def failed_at(
    trace: Trace, plan: Plan, scene: Scene, words: Vocabulary | None = None
) -> str | None:
    """The object or surface that the failed leaf of `plan`, the latest in the trace, worked on."""
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
    """The pose expression that a motion was under way to."""
    nodes = dict(plan.tree.walk()) if plan.tree else {}
    node = nodes.get(leaf.node[leaf.node.find("tree") :])  # without what tells attempts apart
    if node is None:
        return None
    try:
        return words.make(node.type, dict(node.args)).effects(SymbolicState(scene)).at
    except InputError:
        return None


def replan(
    parameters: Sequence[Parameter], scene: Scene, planner: str
) -> tuple[Plan, Scene] | None:
    """A checked plan for the gaps in the scene as it is now; None when there is none."""
    made = assemble(scene, parameters)
    if made.tree is None:
        return None
    plan = Plan(
        made.measured, made.tree, "What is still missing, from where things stand now.", planner
    )
    return None if check(plan, scene) else (plan, scene)


def joined(first: Execution, second: Execution, prefix: str) -> Execution:
    """Both executions as one: the second, whose nodes get the `prefix`, says how it ended, the first
    what it had to get over."""
    a, b = first.trace, _renamed(second.trace, prefix)
    setback = () if first.stopped_by is None else (first.stopped_by,)
    trace = replace(
        b,
        samples=Samples.concatenate([a.samples, b.samples]),
        leaves=(*a.leaves, *b.leaves),
        recordings=(*a.recordings, *b.recordings),
        conversions=(*a.conversions, *b.conversions),
    )
    return replace(
        second,
        trace=trace,
        setbacks=(*first.setbacks, *setback),
        actions=first.actions + second.actions,
        robot_seconds=first.robot_seconds + second.robot_seconds,
        wall_seconds=first.wall_seconds + second.wall_seconds,
    )


def _renamed(trace: Trace, prefix: str) -> Trace:
    """The trace with its nodes told apart from those of earlier attempts."""
    recordings = {r: replace(r, node=prefix + r.node) for r in trace.recordings}
    conversions: list[Conversion] = []
    for conversion in trace.conversions:
        read = recordings.get(conversion.recording, conversion.recording)
        conversions.append(replace(conversion, recording=read))
    return replace(
        trace,
        leaves=tuple(replace(leaf, node=prefix + leaf.node) for leaf in trace.leaves),
        recordings=tuple(recordings.values()),
        conversions=tuple(conversions),
    )


OnFailure = Literal["stop", "skip", "replan"]
