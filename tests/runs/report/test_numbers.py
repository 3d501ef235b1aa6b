"""Numbers as text."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.runs.report.charts import Axis, error_text, with_spread


@pytest.mark.parametrize(
    ("value", "std", "unit", "text"),
    [
        (0.0512, 0.0011, "m", "0.0512 ± 0.0011 m"),
        (0.0094, 0.0011, "m", "9.4 ± 1.1 mm"),
        (0.25, 0.0, "m", "0.25 m"),
        (0.0094, 0.0011, "1", "0.0094 ± 0.0011"),
    ],
)
def test_a_small_length_is_in_millimetres_and_a_pure_number_has_no_unit(
    value: float, std: float, unit: str, text: str
) -> None:
    assert with_spread(value, std, unit) == text


@pytest.mark.parametrize(("truth", "text"), [(0.2, "+50 g (+25 %)"), (0.0, "+2.5e+02 g")])
def test_an_error_is_relative_to_a_truth_that_is_not_zero(truth: float, text: str) -> None:
    assert error_text(0.25, truth, "kg", relative=True) == text


@pytest.mark.parametrize(
    ("values", "low", "high"), [((1, 3), 0.8, 3.2), ((2, 2), 1.8, 2.2), ((0, 0), -1, 1)]
)
def test_an_axis_has_air_around_its_values_and_a_length_also_where_they_are_one(
    values: tuple[float, ...], low: float, high: float
) -> None:
    axis = Axis.enclose(np.array(values), air=0.1)
    assert (axis.low, axis.high) == pytest.approx((low, high))
    assert axis.per_cent(high) == 100.0
