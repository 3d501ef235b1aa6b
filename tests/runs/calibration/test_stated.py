"""Reference values as users write them."""

from __future__ import annotations

import math

import pytest

from palpate.common.errors import InputError
from palpate.runs.calibration.gains import LENGTH, MASS, NamedSize, parse_reference


@pytest.mark.parametrize(
    ("text", "value", "limit"),
    [
        ("0.5kg±0.1g", 0.5, 1e-4),
        ("500 g ± 100 mg", 0.5, 1e-4),
        ("500g+-1", 0.5, 1e-3),
        ("500g+/-1g", 0.5, 1e-3),
        ("0.5", 0.5, 0.0),
        ("5e2g", 0.5, 0.0),
    ],
)
def test_a_mass_and_its_limits_are_parsed(text: str, value: float, limit: float) -> None:
    stated = parse_reference(text, MASS, "the weight")
    assert stated.value == pytest.approx(value)
    assert stated.limit == pytest.approx(limit)
    assert stated.std == pytest.approx(limit / math.sqrt(3))


def test_a_height_and_its_owner_are_parsed() -> None:
    known = NamedSize.of("block=50mm±10um", LENGTH, "the gauge")
    assert known.name == "block"
    assert (known.size.value, known.size.limit) == pytest.approx((0.05, 1e-5))
    assert NamedSize.of("0.05", LENGTH, "the gauge").name is None


@pytest.mark.parametrize(
    "text", ["", "kg", "0kg", "-1kg", "1kg±", "1kg±2kg", "1..2kg", "infkg", "nan", "1lb", "1kg±1mm"]
)
def test_text_that_is_no_mass_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"give e\.g\. 0\.5kg±0\.1g"):
        parse_reference(text, MASS, "the weight")
