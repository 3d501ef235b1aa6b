"""Numbers as text."""

from __future__ import annotations

import pytest

from palpate.report.numbers import error_text, with_spread


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (0.0512, 0.0011, "0.0512 ± 0.0011 m"),
        (0.0094, 0.0011, "9.4 ± 1.1 mm"),
        (0.25, 0.0, "0.25 m"),
    ],
)
def test_a_small_length_is_in_millimetres(value: float, std: float, text: str) -> None:
    assert with_spread(value, std, "m") == text


@pytest.mark.parametrize(("truth", "text"), [(0.2, "+50 g (+25 %)"), (0.0, "+2.5e+02 g")])
def test_an_error_is_relative_to_a_truth_that_is_not_zero(truth: float, text: str) -> None:
    assert error_text(0.25, truth, "kg", relative=True) == text
