"""Tests of fit, as they are written into `result.json`."""

from __future__ import annotations

import json

import numpy as np
import pytest

from palpate.estimation.agreement import FitTest


@pytest.mark.parametrize(("statistic", "passed"), [(1.0, True), (3.0, False), (np.nan, False)])
def test_the_outcome_of_a_numpy_statistic_is_json(statistic: float, passed: bool) -> None:
    test = FitTest("fit", np.float64(statistic), 2.0, "It does not fit.")
    assert json.loads(json.dumps(test.passed)) is passed
