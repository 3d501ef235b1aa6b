"""A load from all that an arm did in free air, on one recorded lift at `lab`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate import pipeline
from palpate.estimation.load.weighing import weigh
from palpate.estimation.load.whole import fit_whole
from palpate.scenarios.catalogue import scenario

TRUTH = 0.187
"""kg."""


@pytest.fixture(scope="module")
def trace():
    settings = scenario("one_missing_mass").settings(noise="lab", seed=501).checked()
    return pipeline.measure(pipeline.plan(settings, pipeline.load(settings))).trace


def test_it_is_narrower_than_the_contrast_along_the_path_and_right(trace):
    weight = weigh(trace, trace.recordings[-1])
    assert weight.whole is not None
    assert abs(weight.mass - TRUTH) < 3.0 * weight.std
    assert weight.std < 0.7e-3


def test_what_the_model_does_not_explain_does_not_count(trace):
    samples = trace.samples
    rippled = samples.tau_ext.copy()
    rippled[:, 1] += 0.1 * np.sin(30.0 * samples.q[:, 1])
    spoilt = replace(trace, samples=replace(samples, tau_ext=rippled))
    weight = weigh(spoilt, spoilt.recordings[-1])
    assert weight.whole is None
    whole = fit_whole(spoilt, "green_bottle", weight.weighings[0].noise, 1.8)
    assert whole is not None
    assert not whole.explains
