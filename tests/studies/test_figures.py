"""Rates and ranged figures: their 95 % intervals are the textbook's."""

from __future__ import annotations

from math import sqrt
from statistics import NormalDist

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from palpate.studies.efficiency import RangedValue, Rate


@pytest.mark.parametrize(
    ("hits", "trials", "low", "high"),
    [(10, 10, 0.7225, 1.0), (0, 10, 0.0, 0.2775), (5, 10, 0.2366, 0.7634), (20, 20, 0.8389, 1.0)],
)
def test_the_wilson_interval_is_the_textbook_one(
    hits: int, trials: int, low: float, high: float
) -> None:
    assert Rate(hits, trials).interval == pytest.approx((low, high), abs=1e-4)


@settings(deadline=None)
@given(st.integers(1, 200).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_the_interval_is_wilsons_formula(counts: tuple[int, int]) -> None:
    hits, n = counts
    rate, z = hits / n, NormalDist().inv_cdf(0.975)
    centre = rate + z * z / (2 * n)
    half = z * sqrt(rate * (1 - rate) / n + (z / (2 * n)) ** 2)
    scale = 1 + z * z / n
    expected = max(0.0, (centre - half) / scale), min(1.0, (centre + half) / scale)
    assert Rate(*counts).interval == pytest.approx(expected, abs=1e-9)


def test_the_interval_of_a_rate_without_trials_is_the_whole_range() -> None:
    assert Rate(0, 0).interval == (0.0, 1.0)


def test_a_root_mean_square_has_the_interval_of_chi_squared() -> None:
    numbers = np.array([3.0, -4.0, 0.0, 1.0])
    result = RangedValue.rms(numbers)
    assert result.value == pytest.approx(sqrt(26 / 4))
    ends = [sqrt(26 / chi2.ppf(p, 4)) for p in (0.975, 0.025)]
    assert (result.low, result.high) == pytest.approx(ends)
