"""A coloured residual, learned from the recording, widens an interval to the right size."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.estimation.coloured_residual import (
    ColouredResidual,
    Spans,
    learn_residual,
    with_residual,
)
from palpate.estimation.regression import Cause, SignalNoise, fit

ROWS, SIGNALS, TRIALS = 80, 2, 60
TIME = 0.1 * np.arange(ROWS)
APART = np.abs(TIME[:, None] - TIME)
STILL = np.zeros((ROWS, SIGNALS))
SPANS = Spans(TIME, np.zeros(ROWS), STILL, STILL)
WHITE = 0.02
"""N m of a row."""


def fitted(y: np.ndarray, learn: bool):
    """A load that hangs for 3 s, beside zeros."""
    here = ((TIME > 2.0) & (TIME < 5.0)).astype(float)
    load = np.concatenate([0.5 * here, 0.2 * here])[:, None]
    zeros = np.kron(np.eye(SIGNALS), np.ones((ROWS, 1)))
    causes = [Cause("load", load, np.array([1e3])), Cause("zero", zeros, np.full(SIGNALS, 10.0))]
    noise = SignalNoise([WHITE * np.eye(ROWS)] * SIGNALS, 40.0)
    if learn:
        noise = with_residual(noise, learn_residual(causes, noise, y, SPANS), SPANS)
    mean, covariance = fit(causes, noise, y)["load"]
    return float(mean[0]), float(np.sqrt(covariance[0, 0]))


def scores(size: float, slowness: float, learn: bool = True):
    """Errors in standard deviations, and the deviations, of loads that are not there."""
    random = np.random.default_rng(1)
    root = np.linalg.cholesky(size**2 * np.exp(-APART / slowness) + WHITE**2 * np.eye(ROWS))
    found = [
        fitted((root @ random.standard_normal((ROWS, SIGNALS))).T.ravel(), learn)
        for _ in range(TRIALS)
    ]
    means, stds = np.array(found).T
    return means / stds, stds


@pytest.mark.parametrize(("size", "slowness"), [(0.1, 0.2), (0.1, 0.6), (0.03, 0.3)])
def test_a_coloured_residual_widens_to_the_right_size(size, slowness):
    z, stds = scores(size, slowness)
    blind, narrow = scores(size, slowness, learn=False)
    assert np.sqrt(np.mean(blind**2)) > 1.6
    assert np.median(stds) > 1.6 * np.median(narrow)
    assert 0.7 < np.sqrt(np.mean(z**2)) < 1.35
    assert np.mean(np.abs(z) < 1.96) > 0.88


def test_white_noise_widens_nothing():
    z, stds = scores(0.0, 1.0)
    _, narrow = scores(0.0, 1.0, learn=False)
    assert np.mean(stds) < 1.1 * np.mean(narrow)
    assert np.sqrt(np.mean(z**2)) < 1.3


def test_a_mean_over_a_long_stretch_errs_less_and_one_at_rest_does_not():
    # Half of the variance is that of gears, over the path alone.
    sizes = np.zeros((1, len(SPANS.kernels(0))))
    sizes[0, [0, -1]] = 0.5
    residual = ColouredResidual(sizes, np.array([10.0]))

    def variance(lasts: float, turns: float) -> float:
        one = np.ones(1)
        spans = Spans(one, lasts * one, np.zeros((1, 1)), turns * np.ones((1, 1)))
        return float(residual.covariance(spans, 0)[0, 0])

    assert variance(0.0, 0.0) == pytest.approx(1.0)
    assert variance(5.0, 0.0) == pytest.approx(0.5, abs=0.01)
    assert variance(5.0, 5.0) < 0.05


def test_a_known_residual_says_how_sure_its_size_is():
    residual = ColouredResidual(
        np.full((SIGNALS, len(SPANS.kernels(0))), 0.01), np.full(SIGNALS, 8.0)
    )
    alone = residual.freedom_beside(np.full(SIGNALS, 1e-9), 100.0, SPANS)
    beside = residual.freedom_beside(np.full(SIGNALS, 1e3), 100.0, SPANS)
    assert alone == pytest.approx(8.0)
    assert beside == pytest.approx(100.0, rel=0.01)


def test_errors_that_depend_on_the_angle_cancel_between_passes():
    """A joint passes the same angles twice, with a load of 0.5 N m the second time."""
    random = np.random.default_rng(2)
    half = ROWS // 2
    angle = np.tile(0.02 * np.arange(half), 2)[:, None]
    path = 0.02 * np.arange(ROWS)[:, None]
    turns, lasts = np.full((ROWS, 1), 0.02), np.full(ROWS, 0.1)
    load = (np.arange(ROWS) >= half).astype(float)[:, None]
    causes = [Cause("load", load, np.array([1e3])), Cause("zero", np.ones((ROWS, 1)), np.ones(1))]
    noise = SignalNoise([WHITE * np.eye(ROWS)], 40.0)

    def fitted_load(spans: Spans, y: np.ndarray) -> tuple[float, float]:
        learned = with_residual(noise, learn_residual(causes, noise, y, spans), spans)
        mean, covariance = fit(causes, learned, y)["load"]
        return float(mean[0]), float(np.sqrt(covariance[0, 0]))

    z, widths = [], []
    for _ in range(TRIALS // 3):
        uneven = np.tile(0.1 * np.cumsum(random.standard_normal(half)) / np.sqrt(10.0), 2)
        y = 0.5 * load[:, 0] + uneven + WHITE * random.standard_normal(ROWS)
        found, std = fitted_load(Spans(TIME, lasts, path, turns, angle), y)
        _, blind = fitted_load(Spans(TIME, lasts, path, turns), y)
        z.append((found - 0.5) / std)
        widths.append(std / blind)
    assert np.mean(widths) < 0.6
    assert np.sqrt(np.mean(np.square(z))) < 1.3
