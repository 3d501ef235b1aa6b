"""The symbolic planner's own plans in physics: no bundled scenario's plan does harm where all is as believed."""

from __future__ import annotations

import pytest

from palpate.execution.rehearsal import rehearse
from palpate.runs import pipeline
from palpate.studies.scenarios.catalogue import scenario

pytestmark = pytest.mark.long

NAMES = (
    "bottle_and_table",
    "clutter",
    "drawer",
    "friction",
    "hammer",
    "hidden_geometry",
    "occlusion",
    "synthetic_and_real",
    "two_of_three",
)


@pytest.mark.parametrize("name", NAMES)
def test_a_scenarios_plan_passes_its_rehearsal(name: str) -> None:
    settings = scenario(name).settings()
    run = pipeline.plan(settings, pipeline.load(settings))
    predicted = rehearse(run.plan, run.scene, draws=0)
    assert predicted.failure is None
    assert predicted.actions == run.plan.actions
