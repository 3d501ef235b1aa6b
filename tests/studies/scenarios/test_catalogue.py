"""Every bundled scenario once, with the planner it is meant for, judged from its trace and the
hidden world."""

from __future__ import annotations

from pathlib import Path

import pytest
from long_cases import mark_long

from palpate.common.errors import InputError
from palpate.runs import pipeline
from palpate.studies.scenarios.catalogue import scenario, scenarios

from .judge import assert_acquired, assert_exported, assert_near_truth, assert_restored, executed

ELSEWHERE = ("vision/contents", "vision/labels", "vision/open_box")
"""Moved as `two_of_three` is: what is special about them is judged in `test_vision`."""
ENDING = [n for n in scenarios() if not n.startswith("mishaps/") and n not in ELSEWHERE]


SHORT = ("bottle_and_table", "one_missing_mass", "soft_mat", "thermometer", "water_temperature")


@pytest.mark.parametrize(
    "name",
    mark_long(ENDING, lambda name: name not in SHORT and not name.startswith("vision/")),
)
def test_a_scenario_ends_as_it_should(name: str, tmp_path: Path) -> None:
    chosen = scenario(name)
    run = executed(chosen)
    assert run.status == chosen.status, run.plan.explanation
    if chosen.status == "rejected":
        assert run.execution is run.footage is None
        assert run.plan.explanation
        return
    assert set(run.plan.parameters) == set(chosen.expects)
    assert_acquired(run, chosen.expects, chosen.may_touch)
    assert_near_truth(run)
    assert_restored(run)
    assert_exported(run, tmp_path)


def test_unknown_scenario_lists_those_there_are() -> None:
    with pytest.raises(InputError, match="bottle_and_table"):
        scenario("atlantis")


def test_a_group_of_scenarios_lists_its_sub_cases() -> None:
    with pytest.raises(
        InputError, match="choose one: mishaps/obstacle, mishaps/slip, mishaps/too_heavy"
    ):
        scenario("mishaps")


def test_a_sub_case_shares_the_files_that_it_has_not_got_itself() -> None:
    photo, rendering = (
        scenario("synthetic_and_real").settings(),
        scenario("synthetic_and_real/rendering").settings(),
    )
    assert (photo.scene, photo.world) == (rendering.scene, rendering.world)
    assert photo.images != rendering.images
    assert photo.planner != rendering.planner


def test_recorded_plans_are_chosen_by_name() -> None:
    hammer = scenario("hammer")
    assert set(hammer.plans) == {"model", "paper"}
    assert hammer.settings(planner="replay:paper").planner == f"replay:{hammer.plans['paper']}"
    assert hammer.settings(planner="replay:elsewhere.json").planner == "replay:elsewhere.json"
    assert hammer.settings().planner == "symbolic"


@pytest.mark.parametrize(
    "name", [n for n in ENDING if scenario(n).settings().request and not scenario(n).only_seen]
)
def test_a_scenarios_request_is_read_without_a_question(name: str) -> None:
    task = scenario(name)
    settings = task.settings()
    run = pipeline.plan(settings, pipeline.load(settings))
    assert "please confirm" not in run.plan.explanation
    assert set(run.plan.parameters) == set(task.expects)
