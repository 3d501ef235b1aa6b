"""Valid plans of the bundled scenarios, to be corrupted."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

from palpate.common.errors import PalpateError
from palpate.planning.check.check import check
from palpate.planning.plan import Plan
from palpate.planning.registry import load_proposal
from palpate.runs import pipeline
from palpate.scene.scene import Scene
from palpate.studies.scenarios.catalogue import Scenario, scenario, scenarios

LIGHT = 7
"""Most objects of a scenario that is quick to simulate."""
SHORT = 30
"""Most actions of a plan that is quick to execute."""
PLANNERS = ("symbolic", "exhaustive")


@dataclass(frozen=True, slots=True, eq=False)
class Base:
    """A valid plan and its scene.

    Attributes:
        name: `SCENARIO:PLAN`.
        world: the scenario's hidden world.
        mishap: the scenario is a mishap: any plan fails in it.
    """

    name: str
    scene: Scene
    world: Path | None
    plan: Plan
    mishap: bool

    @property
    def remeasure(self) -> bool:
        """The plan measures what the scene states."""
        return self.name.endswith(":exhaustive")

    @property
    def light(self) -> bool:
        """True if it is executed in seconds and nothing fails by design."""
        quick = len(self.scene.objects) <= LIGHT and self.plan.actions <= SHORT
        return quick and not self.mishap and not self.remeasure


@cache
def bases() -> tuple[Base, ...]:
    """All distinct valid plans of the scenarios that need no picture, in order of name."""
    found: list[Base] = []
    for name, task in scenarios().items():
        if not task.only_seen:
            found += _of(scenario(name))
    return tuple(found)


def _of(task: Scenario) -> list[Base]:
    settings = task.settings()
    scene = pipeline.load(settings)
    if scene is None:
        return []
    mishap = task.name.startswith("mishaps/")
    plans: dict[str, Plan] = {}
    for planner in PLANNERS:
        made = pipeline.plan(task.settings(planner=planner), scene)
        if made.ready:
            plans[planner] = made.plan
    for name, file in task.plans.items():
        try:
            plan = load_proposal(file).plan
        except PalpateError:
            continue
        if plan.tree is not None and not check(plan, scene):
            plans[name] = plan
    found: list[Base] = []
    for name, plan in plans.items():
        if plan.tree not in [base.plan.tree for base in found]:
            found.append(Base(f"{task.name}:{name}", scene, settings.world, plan, mishap))
    return found
