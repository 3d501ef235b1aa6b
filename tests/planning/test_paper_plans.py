"""The trees of the paper's figures, as recorded plans: checked, executed, and judged from the
trace."""

import pytest

from palpate.planning.check.check import check
from palpate.planning.registry import load_proposal
from palpate.runs import pipeline
from palpate.runs.run import Run
from palpate.studies.judgement import objection
from palpate.studies.scenarios.catalogue import scenario

pytestmark = pytest.mark.long

FIGURES = {"bottle_and_table": 17, "one_missing_mass": 12, "friction": 15, "hammer": 28}
"""Scenario, and how many actions its tree has."""


@pytest.mark.parametrize("name", FIGURES)
def test_the_papers_tree_passes_the_check_and_acquires_exactly_what_is_asked(name: str) -> None:
    task = scenario(name)
    settings = task.settings(noise="none").check_values()
    scene = pipeline.load(settings)
    plan = load_proposal(task.folder / "plans" / "paper.json").plan
    assert scene is not None
    assert check(plan, scene) == ()
    assert set(plan.parameters) == set(task.expects)
    run = pipeline.measure(Run(settings, scene, plan))
    assert run.execution is not None
    assert (run.execution.status, run.execution.actions) == ("complete", FIGURES[name])
    assert objection(run.trace, task.expects) == ""
