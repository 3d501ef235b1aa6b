"""Repetition for `--within`: parameters with wider intervals are measured again by the same robot,
until they are narrow enough or at the floor that no repetition lowers.

As in a recovery, a further tree is planned from where things stand now, checked and run, and its
trace is joined to what there is. All of it makes the estimate.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

from palpate.execution.recovery import Runner, joined
from palpate.parameter import Parameter
from palpate.planning.check.check import check
from palpate.planning.plan import Plan
from palpate.planning.symbolic.passes import Efforts, site_of
from palpate.planning.symbolic.planner import assemble
from palpate.quantities.estimators import estimate_all
from palpate.quantities.quantity import Effort
from palpate.quantities.within import Precision, Within, shown
from palpate.robots.robot import Robot
from palpate.scene.load import rearranged
from palpate.scene.raised import as_measured
from palpate.scene.scene import Scene

if TYPE_CHECKING:
    from palpate.execution.runner import Execution

log = logging.getLogger(__name__)

MAX_ROUNDS = 5
"""Largest number of rounds of repetition."""

MOST_TIMES = 4
"""Largest number of repetitions in one round: the noise seen in the first round is uncertain."""

LONGEST = 100.0
"""s of robot time after whose further rounds no other one begins: in a third of a drift's time constant
(300 s, `robots/simulated/noise/lab.yaml`) what is repeated is no longer compared with the same arm; and
what an estimate takes to be computed grows with the cube of what it rests on. A round of twelve
grasps of a hammer takes 115 s."""

FUTILE = 0.98
"""Part of an interval that a round must leave at most, for another one to be worth it."""

Lacking = dict[Parameter, Precision]
"""Parameter with a wider interval than requested."""


def repeat(
    first: Execution,
    plan: Plan,
    scene: Scene,
    robot: Robot,
    within: Within,
    run: Runner,
    say: Callable[[str], None],
) -> Execution:
    """The execution with all further rounds joined to it that `within` makes necessary; `say` is
    told what each is for."""
    done, before = first, Lacking()
    asked = [parameter for parameter in plan.parameters if within.of(parameter) is not None]
    so_far = Counter(asked)
    for count in range(1, MAX_ROUNDS + 1):
        if not asked or done.status != "complete" or _took(done, first) > LONGEST:
            break
        lacking = dict(_lacking(asked, done, scene, within))
        asked = [parameter for parameter in lacking if _is_worth_it(parameter, lacking, before)]
        before = lacking = {parameter: lacking[parameter] for parameter in asked}
        efforts = _efforts(lacking, scene, done, so_far)
        again = _planned(efforts, scene, done, plan.planner, mirrored=count % 2 == 1)
        if again is None:
            break
        for parameter, effort in efforts.items():
            so_far[parameter] += effort.times
        say(f"measuring again, {_in_words(lacking, scene)}")
        done = joined(done, run(*again, robot), f"repeat[{count}].")
    return done


def _took(done: Execution, first: Execution) -> float:
    """s of robot time that further rounds took."""
    return done.robot_seconds - first.robot_seconds


def _lacking(
    asked: Sequence[Parameter], done: Execution, scene: Scene, within: Within
) -> Iterator[tuple[Parameter, Precision]]:
    """Parameters that repetition would narrow: not those contradicted or not identified."""
    for estimate in estimate_all(asked, done.trace, as_measured(scene, done.trace).bodies):
        precision = within.precision(estimate)
        if precision is None or estimate.contradiction or not estimate.has_value:
            continue
        if precision.outcome == "rounds used up":
            yield estimate.parameter, precision


def _is_worth_it(parameter: Parameter, now: Lacking, before: Lacking) -> bool:
    """True if another round may narrow it: the last one has, if there was any."""
    return parameter not in before or now[parameter].reached < FUTILE * before[parameter].reached


def _efforts(
    lacking: Lacking, scene: Scene, done: Execution, so_far: Counter[Parameter]
) -> dict[Parameter, Effort]:
    """Effort that they need with the noise that the arm has shown, as their quantities predict it,
    else extrapolated from `so_far`."""
    found: dict[Parameter, Effort] = {}
    for parameter, precision in lacking.items():
        site, effort = site_of(scene, parameter), None
        if site is not None:
            quantity = scene.catalogue[parameter.quantity]
            effort = quantity.effort(site, precision.further_std, done.trace)
        times = min(precision.further(so_far[parameter]), MOST_TIMES)
        found[parameter] = effort or Effort(times=times)
    return found


def _planned(
    efforts: Efforts, scene: Scene, done: Execution, planner: str, mirrored: bool
) -> tuple[Plan, Scene] | None:
    """A checked plan for them in the scene as it is now, `mirrored` every other time; what was
    executed outlives a planning that fails."""
    if not efforts:
        return None
    try:
        around = rearranged(done.final_state.scene, done.final_state.not_restored())
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


def _in_words(lacking: Lacking, scene: Scene) -> str:
    """`bottle.mass: ± 3.1 g where ± 1 g is asked`."""
    said: list[str] = []
    for parameter, precision in lacking.items():
        unit = scene.catalogue[parameter.quantity].unit
        reached, asked = shown(precision.reached, unit), shown(precision.asked, unit)
        said.append(f"{parameter}: ± {reached} where ± {asked} is asked")
    return ", ".join(said)
