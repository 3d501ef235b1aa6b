"""What intent saves against touching everything."""

from __future__ import annotations

import pytest

from palpate.scenarios.catalogue import scenario
from palpate.studies.accuracy import SeedRun
from palpate.studies.efficiency import Comparison, comparable, efficiency


def test_only_scenarios_that_the_symbolic_planner_completes_are_compared() -> None:
    found = comparable()
    assert found[0] == "bottle_and_table"
    assert "one_missing_mass" in found
    assert all(
        scenario(name).status == "complete" and scenario(name).planner == "symbolic"
        for name in found
    )


def test_time_saved_is_a_fraction_of_the_exhaustive_runs() -> None:
    slow, quick = SeedRun(0, "complete", 29, 62.0, ()), SeedRun(0, "complete", 12, 33.0, ())
    assert Comparison("paper", slow, quick).time_saved == pytest.approx(0.468, abs=1e-3)
    rejected = SeedRun(0, "rejected", 0, 0.0, ())
    assert Comparison("nothing to do", rejected, rejected).time_saved is None


def test_one_missing_mass_takes_less_than_everything() -> None:
    (row,) = efficiency(["one_missing_mass"], noise="none")
    assert row.exhaustive.status == row.intent.status == "complete"
    assert row.intent.actions < row.exhaustive.actions / 2
    assert row.time_saved is not None
    assert row.time_saved > 0.5
    assert {e.parameter for e in row.intent.estimates} == set(scenario("one_missing_mass").expects)
    assert {e.parameter for e in row.intent.estimates} < {
        e.parameter for e in row.exhaustive.estimates
    }
