"""Plans as a model would write them, and the trees of the paper's figures: checked, executed,
judged from the trace."""

from __future__ import annotations

import pytest

from palpate import pipeline
from palpate.planning.plan import Node
from palpate.planning.recorded import load_plan
from palpate.scenarios.catalogue import scenario, scenarios

from .judge import assert_acquired, assert_near_truth, assert_restored, executed
from .test_catalogue import IN_THE_WAY

SYMBOLIC = [
    name
    for name in scenarios()
    if (s := scenario(name)).planner == "symbolic" and s.status == "complete"
]
RECORDED = [
    (name, plan) for name in SYMBOLIC for plan in ("model", "paper") if plan in scenario(name).plans
]


@pytest.mark.parametrize(("name", "plan"), RECORDED)
def test_a_recorded_plan_acquires_exactly_what_is_missing(name: str, plan: str) -> None:
    chosen = scenario(name)
    run = executed(chosen, plan)
    assert run.status == "complete"
    assert set(run.plan.parameters) == set(chosen.expects)
    assert_acquired(run, chosen.expects, IN_THE_WAY.get(name, ()))
    assert_near_truth(run)
    assert_restored(run)


@pytest.mark.parametrize("name", SYMBOLIC)
def test_a_models_plan_is_not_the_planners(name: str) -> None:
    chosen = scenario(name)
    settings = chosen.settings()
    planned = pipeline.plan(settings, pipeline.load(settings)).plan
    recorded = load_plan(chosen.plans["model"])
    assert planned.tree is not None
    assert recorded.tree is not None
    assert (
        _leaves(recorded.tree) != _leaves(planned.tree) or recorded.parameters != planned.parameters
    )
    assert recorded.explanation != planned.explanation


def _leaves(tree: Node) -> list[tuple[str, object]]:
    return [(node.type, node.args) for _, node in tree.walk() if not node.children]
