"""Drift, warming up and flicker have the size, time and spectrum that their figures say."""

from __future__ import annotations

import numpy as np
import pytest
from noises import model, spectrum

from palpate.robots.simulated.noise.values import Streams
from palpate.robots.simulated.noise.wander import Relaxation, Wander

PERIOD = 0.005


def wander(seed: int = 0, **torque: object) -> Wander:
    return Wander(model(torque=torque).torque, PERIOD, Streams(seed))


def test_drift_is_stationary_and_forgets_with_its_time_constant() -> None:
    slow = Relaxation(0.03, 300.0, np.random.default_rng(0), 4000)
    first = slow.value.copy()
    for _ in range(50):
        slow.after(6.0)
    assert first.std() == pytest.approx(0.03, rel=0.05)
    assert slow.value.std() == pytest.approx(0.03, rel=0.05)
    correlation = np.corrcoef(first, slow.value)[0, 1]
    assert correlation == pytest.approx(np.exp(-1), abs=0.05)


def test_steps_of_any_length_make_the_same_drift() -> None:
    steps = {0.04: [], 30.0: []}
    for duration, ends in steps.items():
        slow = Relaxation(1.0, 10.0, np.random.default_rng(1), 3000)
        for _ in range(int(30.0 / duration)):
            slow.after(duration)
        ends.append(slow.value.std())
    assert steps[0.04] == pytest.approx(steps[30.0], rel=0.06)


def test_without_a_time_constant_drift_walks() -> None:
    walk = Relaxation(0.01, np.inf, np.random.default_rng(0), 4000)
    assert not walk.value.any()
    early = walk.after(10.0).std()
    for _ in range(3):
        walk.after(10.0)
    assert walk.value.std() == pytest.approx(2 * early, rel=0.08)
    assert early == pytest.approx(0.01 * np.sqrt(2 * 10 / 300), rel=0.05)


def test_warming_up_takes_its_time_and_a_random_sign() -> None:
    ends: list[float] = []
    for seed in range(30):
        warm = wander(seed, drift={"warm_up": 0.5, "warm_up_time": 10.0})
        reading = np.zeros((2000, 7))
        warm.add(reading)
        ends.extend(reading[-1].tolist())
    assert np.abs(ends) == pytest.approx(0.5 * (1 - np.exp(-1.0)))
    assert 60 < np.sum(np.array(ends) > 0) < 150


def test_flicker_has_one_over_f_in_its_band_and_is_flat_below() -> None:
    level, band = 0.02, (0.05, 20.0)
    noise = wander(flicker={"level": level, "band": list(band)})
    signal = np.zeros((200_000, 7))
    for part in np.split(signal, 5000):
        noise.add(part)
    pieces = [spectrum(piece, PERIOD) for piece in np.split(signal, 5)]
    f, density = pieces[0][0], np.mean([piece[1] for piece in pieces], axis=0)
    inside = (f > 0.1) & (f < 4.0)
    within = 2 / np.pi * (np.arctan(band[1] / f) - np.arctan(band[0] / f))  # half at the edges
    assert np.mean((density * f / within)[inside]) == pytest.approx(level**2, rel=0.06)
    middle = (f > 0.3) & (f < 3.0)
    slope = np.polyfit(np.log(f[middle]), np.log(density[middle]), 1)[0]
    assert slope == pytest.approx(-1.0, abs=0.06)
    below = density[(f > 0.008) & (f < 0.025)].mean()
    assert below == pytest.approx(level**2 / band[0], rel=0.35)
    above = density[(f > 50.0) & (f < 90.0)].mean()
    assert above < 0.5 * level**2 / 70.0, "it falls off faster"
