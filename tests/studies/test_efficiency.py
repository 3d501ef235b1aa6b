"""Effort of the intent-driven planner against the exhaustive one."""

from __future__ import annotations

import re

import plotly.graph_objects as go
import pytest

from palpate.studies.accuracy import SeedRun
from palpate.studies.efficiency import (
    PAPER,
    PlannerComparison,
    comparable,
    efficiency,
    efficiency_figure,
    plot,
)
from palpate.studies.scenarios.catalogue import scenario


def test_scenarios_completed_by_the_symbolic_planner_are_compared() -> None:
    result = comparable()
    assert result[0] == "bottle_and_table"
    assert "one_missing_mass" in result
    assert all(
        scenario(name).status == "complete" and scenario(name).planner == "symbolic"
        for name in result
    )


def test_time_saved_is_a_fraction_of_the_exhaustive_runs() -> None:
    slow, quick = SeedRun(0, "complete", 29, 62.0, ()), SeedRun(0, "complete", 12, 33.0, ())
    assert PlannerComparison("paper", slow, quick).time_saved == pytest.approx(0.468, abs=1e-3)
    rejected = SeedRun(0, "rejected", 0, 0.0, ())
    assert PlannerComparison("nothing to do", rejected, rejected).time_saved is None


@pytest.mark.long
def test_a_single_missing_mass_takes_fewer_actions_than_everything() -> None:
    (row,) = efficiency(["one_missing_mass"], noise="none")
    assert row.exhaustive.status == row.intent.status == "complete"
    assert row.intent.actions < row.exhaustive.actions / 2
    assert row.time_saved is not None
    assert row.time_saved > 0.5
    assert {e.parameter for e in row.intent.estimates} == set(scenario("one_missing_mass").expects)
    assert {e.parameter for e in row.intent.estimates} < {
        e.parameter for e in row.exhaustive.estimates
    }


def seed_run(actions: int, seconds: float) -> SeedRun:
    return SeedRun(0, "complete", actions, seconds, ())


ROWS = [
    PlannerComparison("one_missing_mass", seed_run(20, 41.5), seed_run(8, 17.25)),
    PlannerComparison("a<b", seed_run(30, 60.0), seed_run(12, 30.0)),
]


def test_plotly_accepts_the_efficiency_figure() -> None:
    figure = go.Figure(efficiency_figure(ROWS))
    bars = {(bar.name, bar.yaxis): list(bar.y) for bar in figure.data}
    assert bars == {
        ("exhaustive", "y"): [20, 30, PAPER.exhaustive_actions],
        ("intent-driven", "y"): [8, 12, PAPER.intent_actions],
        ("exhaustive", "y2"): [41.5, 60.0, PAPER.exhaustive_seconds],
        ("intent-driven", "y2"): [17.25, 30.0, PAPER.intent_seconds],
    }


def test_published_bars_are_paler_than_measured_ones() -> None:
    for bar in efficiency_figure(ROWS)["data"]:
        *measured, paper = bar["marker"]["opacity"]
        assert all(paper < opacity for opacity in measured)


def test_scenario_names_are_escaped_in_the_efficiency_figure() -> None:
    assert efficiency_figure(ROWS)["data"][0]["x"][1] == "a&lt;b"


def test_efficiency_page_loads_nothing_from_the_network() -> None:
    page = plot(ROWS)
    assert "Plotly.newPlot" in page
    assert "one_missing_mass" in page
    assert not re.search(r"<(script|link|img)[^>]*\s(src|href)=", page)
