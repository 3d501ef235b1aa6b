"""Plans as a model would write them, and the trees of the paper's figures: checked, executed,
judged from the trace."""

from __future__ import annotations

from dataclasses import replace

import pytest
from long_cases import mark_long

from palpate.planning.plan import Node
from palpate.planning.registry import load_proposal
from palpate.runs import pipeline
from palpate.studies.scenarios.catalogue import scenario, scenarios

from .judge import assert_acquired, assert_near_truth, assert_restored, executed

SYMBOLIC = [
    name
    for name in scenarios()
    if (s := scenario(name)).planner == "symbolic" and s.status == "complete" and "model" in s.plans
]
LONG = "fifteen_objects"
"""What its plan does is executed once, as the planner wrote it; a model's is checked."""
RECORDED = [
    (name, plan)
    for name in SYMBOLIC
    for plan in ("model", "paper")
    if plan in scenario(name).plans and name != LONG
]


@pytest.mark.long
@pytest.mark.parametrize(("name", "plan"), RECORDED)
def test_a_recorded_plan_acquires_exactly_what_is_missing(name: str, plan: str) -> None:
    chosen = scenario(name)
    run = executed(chosen, plan)
    assert run.status == "complete"
    assert set(run.plan.parameters) == set(chosen.expects)
    assert_acquired(run, chosen.expects, chosen.may_touch)
    assert_near_truth(run)
    assert_restored(run)


def test_a_long_recorded_plan_passes_the_check_and_promises_exactly_what_is_missing() -> None:
    chosen = scenario(LONG)
    settings = replace(chosen.settings(), planner=f"replay:{chosen.plans['model']}")
    run = pipeline.plan(settings, pipeline.load(settings))
    assert run.findings == ()
    assert set(run.plan.parameters) == set(chosen.expects)


@pytest.mark.parametrize("name", mark_long(SYMBOLIC, lambda name: name == "hammer"))
def test_a_models_plan_is_not_the_planners(name: str) -> None:
    chosen = scenario(name)
    settings = chosen.settings()
    planned = pipeline.plan(settings, pipeline.load(settings)).plan
    recorded = load_proposal(chosen.plans["model"]).plan
    assert planned.tree is not None
    assert recorded.tree is not None
    assert (
        _leaves(recorded.tree) != _leaves(planned.tree) or recorded.parameters != planned.parameters
    )
    assert recorded.explanation != planned.explanation


def _leaves(tree: Node) -> list[tuple[str, object]]:
    return [(node.type, node.args) for _, node in tree.walk() if not node.children]
