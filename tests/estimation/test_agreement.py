"""Tests of fit, as they are written into `result.json`."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from scipy.stats import truncnorm

from palpate.estimation.estimate import Bound, FitTest, reached_bound


@pytest.mark.parametrize(("statistic", "passed"), [(1.0, True), (3.0, False), (np.nan, False)])
def test_the_outcome_of_a_numpy_statistic_is_json(statistic: float, passed: bool) -> None:
    test = FitTest("fit", np.float64(statistic), 2.0, "It does not fit.")
    assert json.loads(json.dumps(test.passed)) is passed


@pytest.mark.parametrize("truth", [0.0, 0.5, 1.0, 3.0])
@pytest.mark.parametrize("freedom", [4.0, math.inf])
def test_a_one_sided_limit_covers_95_per_cent_at_every_truth(truth: float, freedom: float) -> None:
    random = np.random.default_rng(3)
    errors = random.normal(size=4000) if math.isinf(freedom) else random.standard_t(freedom, 4000)
    limits = [Bound(0.0).limit(truth + error, 1.0, freedom) for error in errors.tolist()]
    assert np.mean(np.array(limits) >= truth) >= 0.94
    assert min(limits) > 0.0
    # Far from the bound it is the textbook's one-sided limit.
    assert Bound(0.0).limit(50.0, 1.0) == pytest.approx(51.645, abs=1e-3)


@pytest.mark.parametrize("value", [-3.0, -0.4, 0.0, 1.5])
def test_the_moments_given_a_bound_are_those_of_a_truncated_normal(value: float) -> None:
    mean, std = Bound(0.0).moments(value, 2.0)
    given = truncnorm(-value / 2.0, np.inf, loc=value, scale=2.0)
    assert (mean, std) == pytest.approx((given.mean(), given.std()), rel=1e-6)
    upper = Bound(1.0, -1)
    assert upper.moments(1.0 - value, 2.0) == pytest.approx((1.0 - mean, std))
    assert upper.limit(1.0 - value, 2.0) == pytest.approx(1.0 - Bound(0.0).limit(value, 2.0))


def test_an_interval_names_the_bound_that_it_reaches() -> None:
    assert reached_bound(0.0, 0.4, (0.0, 1.0)) == Bound(0.0)
    assert reached_bound(0.7, 1.2, (0.0, 1.0)) == Bound(1.0, -1)
    assert reached_bound(0.1, 0.4, (0.0, 1.0)) is None
    assert reached_bound(0.0, 0.0, (0.0, 1.0)) is None
