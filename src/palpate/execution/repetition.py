"""Repetition for `--within`: the same robot measures parameters with wider intervals again, until
they are narrow enough or at the floor that no repetition lowers.

As in a recovery, a further tree is planned for the present cell, checked and run, and its trace is joined
to the earlier ones. The estimate is made from all of it.
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

MAX_ROUNDS = 5  # Largest number of rounds of repetition
MOST_TIMES = 4
"""Largest number of repetitions in one round: the noise seen in the first round is uncertain."""
LONGEST = 100.0
"""s of robot time of further rounds after which none begins. In a third of a drift's time constant
(300 s, `robots/simulated/noise/lab.yaml`) the arm is no longer the same one; and the cost of an estimate
grows with the cube of its data. A round of twelve grasps of a hammer takes 115 s."""
FUTILE = 0.98
"""Largest part of an interval that may remain after a round, for another one to follow."""

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
    """The execution joined with all further rounds that `within` requires; `say` shows the purpose of
    each."""
    done, before = first, Lacking()
    asked = [parameter for parameter in plan.parameters if within.of(parameter) is not None]
    so_far = Counter(asked)
    for count in range(1, MAX_ROUNDS + 1):
        took = done.robot_seconds - first.robot_seconds
        if not asked or done.status != "complete" or took > LONGEST:
            break
        lacking = dict(too_wide(asked, done, scene, within))
        # Another round only where the last one narrowed the interval, if there was any.
        asked = [
            parameter
            for parameter, now in lacking.items()
            if parameter not in before or now.reached < FUTILE * before[parameter].reached
        ]
        before = lacking = {parameter: lacking[parameter] for parameter in asked}
        efforts = efforts_for(lacking, scene, done, so_far)
        again = replanned(efforts, done, plan.planner, mirrored=count % 2 == 1)
        if again is None:
            break
        for parameter, effort in efforts.items():
            so_far[parameter] += effort.times
        say(f"measuring again, {widths_in_words(lacking, scene)}")
        done = joined(done, run(*again, robot), f"repeat[{count}].")
    return done


def too_wide(
    asked: Sequence[Parameter], done: Execution, scene: Scene, within: Within
) -> Iterator[tuple[Parameter, Precision]]:
    """Parameters whose interval repetition would narrow; none contradicted or not identified."""
    for estimate in estimate_all(asked, done.trace, as_measured(scene, done.trace).bodies):
        precision = within.precision(estimate)
        if precision is None or estimate.contradiction or not estimate.has_value:
            continue
        if precision.outcome == "rounds used up":
            yield estimate.parameter, precision


def efforts_for(
    lacking: Lacking, scene: Scene, done: Execution, so_far: Counter[Parameter]
) -> dict[Parameter, Effort]:
    """Effort for each, predicted by its quantity from the arm's noise in the trace, else extrapolated
    from the repetitions `so_far`."""
    found: dict[Parameter, Effort] = {}
    for parameter, precision in lacking.items():
        site, effort = site_of(scene, parameter), None
        if site is not None:
            quantity = scene.catalogue[parameter.quantity]
            effort = quantity.effort(site, precision.further_std, done.trace)
        times = min(precision.further(so_far[parameter]), MOST_TIMES)
        found[parameter] = effort or Effort(times=times)
    return found


def replanned(
    efforts: Efforts, done: Execution, planner: str, mirrored: bool
) -> tuple[Plan, Scene] | None:
    """A checked plan for the parameters in the present scene, `mirrored` every other time; None
    without one, or where planning fails."""
    if not efforts:
        return None
    try:
        around = rearranged(done.final_state.scene, done.final_state.elsewhere())
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
    """List in words: `bottle.mass: ± 3.1 g where ± 1 g is asked`."""
    said: list[str] = []
    for parameter, precision in lacking.items():
        unit = scene.catalogue[parameter.quantity].unit
        reached, asked = shown(precision.reached, unit), shown(precision.asked, unit)
        said.append(f"{parameter}: ± {reached} where ± {asked} is asked")
    return ", ".join(said)
