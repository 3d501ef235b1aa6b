"""Statistics over seeds, with the intervals of the textbook."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import t

from palpate.common.parameter import Parameter
from palpate.studies.accuracy import ScoredEstimate, SeedRun
from palpate.studies.summary import Scores, levels, summarise

MASS = Parameter("cup", "mass")


def scored(seed: int, value: float, std: float = 0.01, shot: float | None = None) -> ScoredEstimate:
    return ScoredEstimate(MASS, 0, seed, value, std, value - 0.02, value + 0.02, 0.3, shot)


def drawn(count: int, freedom: float, stated: float = 1.0) -> list[ScoredEstimate]:
    """Estimates whose errors follow Student's t with the stated scale times `stated`."""
    random = np.random.default_rng(5)
    half = float(t.ppf(0.975, freedom))
    result: list[ScoredEstimate] = []
    for seed, error in enumerate(random.standard_t(freedom, count) / stated):
        ends = (2.0 + error - half, 2.0 + error + half)
        result.append(ScoredEstimate(MASS, 0, seed, 2.0 + error, 1.0, *ends, 2.0, None))
    return result


def test_the_summary_is_over_seeds() -> None:
    runs = [
        SeedRun(i, "complete", 12, 20.0, (scored(i, value, shot=value + 0.05),))
        for i, value in enumerate((0.29, 0.31, 0.33))
    ]
    (row,) = summarise(runs)
    assert (row.parameter, row.component, row.runs) == (MASS, 0, 3)
    assert row.truth == pytest.approx(0.3)
    assert row.mean == pytest.approx(0.31)
    assert row.bias == pytest.approx(0.01)
    assert row.sd == pytest.approx(0.02)
    assert row.claimed == pytest.approx(0.01)
    assert row.covered == 2
    assert row.single_shot_sd == pytest.approx(0.02)


def test_summary_of_one_run_has_no_scatter() -> None:
    (row,) = summarise([SeedRun(0, "complete", 12, 20.0, (scored(0, 0.31),))])
    assert row.sd == 0.0
    assert row.single_shot_sd is None


def test_each_component_has_a_row() -> None:
    com = Parameter("cup", "com")
    trials = tuple(
        replace(scored(0, 0.1 * i), parameter=com, component=i, truth=0.1 * i) for i in range(3)
    )
    assert [
        (row.component, row.bias) for row in summarise([SeedRun(0, "complete", 1, 1.0, trials)])
    ] == [(0, 0.0), (1, 0.0), (2, 0.0)]


def test_doubted_or_unmeasured_values_count_as_requested_only() -> None:
    doubted = replace(scored(1, 9.0), verdict="contradicted")
    runs = [
        SeedRun(0, "complete", 12, 20.0, (scored(0, 0.31),)),
        SeedRun(1, "failed", 12, 20.0, (), (doubted,)),
        SeedRun(2, "crashed", 0, 0.0, ()),
    ]
    (row,) = summarise(runs)
    assert (row.runs, row.asked, row.mean) == (1, 3, 0.31)
    assert row.verdicts == {"identified": 1, "contradicted": 1}


@pytest.mark.parametrize("freedom", [4, 30, 1e9])
def test_calibrated_estimates_cover_every_level(freedom: float) -> None:
    """The degrees of freedom are read back from the intervals."""
    level_counts = levels(drawn(4000, freedom))
    for nominal in (0.2, 0.5, 0.8, 0.95):
        assert np.mean(level_counts <= nominal) == pytest.approx(nominal, abs=0.02)


def test_scores_separate_cautious_from_overconfident_estimates() -> None:
    cautious, overconfident = (
        Scores.of(drawn(400, 1e9, stated=2.0)),
        Scores.of(drawn(400, 1e9, stated=0.5)),
    )
    assert cautious.stated.low < 2.0 < cautious.stated.high
    assert overconfident.stated.low < 0.5 < overconfident.stated.high
    assert overconfident.coverage95.high < 0.8 < 0.95 < cautious.coverage95.low
    assert overconfident.coverage50.high < 0.5 < cautious.coverage50.low
    assert 5 < overconfident.worst < 9


def test_an_interval_that_ends_where_a_mass_does_counts_by_its_upper_half() -> None:
    (level,) = levels([ScoredEstimate(MASS, 0, 0, 1.0, 1.0, 0.0, 2.96, 1.6745, None)])
    assert level == pytest.approx(0.5, abs=0.01)
