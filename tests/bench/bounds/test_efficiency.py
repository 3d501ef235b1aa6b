"""Errors over Cramér-Rao bounds, of a bundled scenario."""

from __future__ import annotations

import pytest

from bench.bounds.efficiency import over_bounds

pytestmark = pytest.mark.long


def test_a_mass_has_an_error_over_their_bound() -> None:
    rows = over_bounds(["one_missing_mass"], "lab", range(2))
    assert [(row.component, row.values) for row in rows] == [("green_bottle.mass", 2)]
    assert 0 < rows[0].ratio.value < 4
