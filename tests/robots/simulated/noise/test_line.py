"""From readings to samples: white noise, filter, delay, quantisation, outliers, gaps, repeats."""

from __future__ import annotations

import numpy as np
import pytest
from noises import model

from palpate.robots.simulated.noise.line import SignalLine, Stamps
from palpate.robots.simulated.noise.model import Streams

RUNS = 500
"""of 8 log periods each."""


def line(acquisition: dict[str, object] | None = None, **torque: object) -> SignalLine:
    noise = model(torque=torque, acquisition=acquisition or {})
    return SignalLine(noise.torque, noise.acquisition, Streams(0))


def carried(found: SignalLine, reading: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Samples and which arrived, of readings that come in runs of 8 log periods."""
    parts = [found.carry(part) for part in np.split(reading, len(reading) // 8)]
    arrived = [np.ones(8, bool) if part[1] is None else part[1] for part in parts]
    return np.concatenate([part[0] for part in parts]), np.concatenate(arrived)


def still(count: int = 8 * RUNS, value: float = 0.0) -> np.ndarray:
    return np.full((count, 7), value)


WHITE = [0.1, 0.1, 0.1, 0.1, 0.05, 0.05, 0.05]


@pytest.mark.parametrize("more", [{}, {"quantisation": 1e-9}])
def test_white_noise_is_that_of_a_mean_of_five_samples(more: dict[str, object]) -> None:
    samples, _ = carried(line(white=WHITE, **more), still())
    assert samples.std(0) == pytest.approx(np.array(WHITE) / np.sqrt(5), rel=0.06)
    assert abs(np.corrcoef(samples[:-1, 0], samples[1:, 0])[0, 1]) < 0.06


def test_the_reading_is_quantised() -> None:
    samples, _ = carried(line(quantisation=0.25), still(8, 1.1))
    assert samples == pytest.approx(still(8, 1.0))


def test_noise_dithers_the_steps() -> None:
    samples, _ = carried(line(white=0.3, quantisation=0.25), still(value=1.1))
    assert samples.mean() == pytest.approx(1.1, abs=0.005)


def test_the_reading_saturates() -> None:
    samples, _ = carried(line(range=[87, 87, 87, 87, 12, 12, 12]), still(8, -50.0))
    assert samples[0] == pytest.approx([-50] * 4 + [-12] * 3)


def test_the_filter_is_a_first_order_low_pass() -> None:
    step = np.concatenate([still(80), still(80, 1.0)])
    samples, _ = carried(line(filter=10.0), step)
    assert samples[:80] == pytest.approx(still(80))
    times = 0.005 * np.arange(80) + 0.003  # the middle sample of each block, 1 ms after the step's
    expected = 1 - np.exp(-2 * np.pi * 10.0 * times)
    assert samples[80:, 0] == pytest.approx(expected, abs=0.02)


@pytest.mark.parametrize("delay", [0.002, 0.0125])
def test_torque_is_delayed(delay: float) -> None:
    t = 0.005 * np.arange(160)
    ramp = np.outer(t, np.ones(7))
    samples, _ = carried(line(delay=delay), ramp)
    assert np.mean(ramp[20:] - samples[20:]) == pytest.approx(delay, rel=1e-6)


def test_outliers_are_single_samples_at_their_rate() -> None:
    found = line({"outliers": {"rate": 0.5, "size": 5.0}})
    samples, _ = carried(found, still())
    seconds, hit = 8 * RUNS * 0.005, samples != 0.0
    assert hit.sum() == pytest.approx(0.5 * 7 * seconds, abs=4 * np.sqrt(0.5 * 7 * seconds))
    sizes = np.abs(samples[hit]) * 5  # of a single sample in a mean of five
    assert np.median(sizes) == pytest.approx(5.0 * 0.816, rel=0.4), "of Student's t, 2 dof"
    assert sizes.max() > 15.0, "heavy tailed"


def test_samples_are_dropped_at_their_rate_and_gaps_have_their_length() -> None:
    found = line({"dropped": {"rate": 2.0, "length": 0.02}})
    _, arrived = carried(found, still())
    assert np.mean(~arrived) == pytest.approx(2.0 * 0.016, rel=0.5)  # whole blocks in 20 ms: 3 or 4
    edges = np.flatnonzero(np.diff(np.concatenate([[1], arrived.astype(int), [1]])))
    gaps = edges[1::2] - edges[::2]
    assert gaps.min() >= 3
    assert np.median(gaps) in (3, 4)


def test_missing_samples_repeat_the_last_that_arrived() -> None:
    found = line({"dropped": {"rate": 2.0, "length": 0.02}})
    samples, arrived = carried(found, still(value=30.0))
    assert not arrived.all()
    assert samples == pytest.approx(still(value=30.0))


def test_short_gaps_only_make_a_mean_of_fewer_samples() -> None:
    found = line({"dropped": {"rate": 50.0, "length": 0.002}}, white=0.1)
    samples, arrived = carried(found, still())
    assert np.mean(arrived) > 0.99
    assert 0.1 / np.sqrt(5) < samples[arrived].std() < 0.1 / np.sqrt(4)
    assert np.isfinite(samples).all()


def test_repeated_samples_make_the_mean_noisier() -> None:
    samples, _ = carried(line({"repeated": 0.5}, white=0.1), still())
    plain, _ = carried(line(white=0.1), still())
    assert samples.std() > 1.3 * plain.std()
    assert np.corrcoef(samples[:-1, 0], samples[1:, 0])[0, 1] > 0.05, "over the edge of a block"


def stamps(**figures: object) -> Stamps:
    return Stamps(model(acquisition=figures).acquisition, Streams(0))


def test_stamps_jitter_and_stay_in_order() -> None:
    t = 0.005 * np.arange(1.0, 4001)
    assert (stamps().of(t) == t).all()
    assert (stamps(jitter=1e-4).of(t) - t).std() == pytest.approx(1e-4, rel=0.05)
    assert (np.diff(stamps(jitter=0.01).of(t)) > 0).all()


def test_a_clock_has_its_own_rate() -> None:
    assert stamps(clock={"fixed": 1e-3}).of(np.array([100.0])) == pytest.approx([100.1])
    rates = [
        Stamps(model(acquisition={"clock": 1e-4}).acquisition, Streams(s)).rate for s in range(200)
    ]
    assert np.std(rates) == pytest.approx(1e-4, rel=0.15)
