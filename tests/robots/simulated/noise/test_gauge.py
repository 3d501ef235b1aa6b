"""Torque sensors: gain, cross-talk, curvature, hysteresis, ripple, drift, warm-up and flicker."""

from __future__ import annotations

import numpy as np
import pytest
from noises import ARM, model, spectrum

from palpate.robots.simulated.noise.model import Streams
from palpate.robots.simulated.noise.sensors import Gauges, Relaxation, Wander

Q = ARM.home


def gauges(seed: int = 0, **torque: object) -> Gauges:
    return Gauges(model(torque=torque).torque, ARM.limits.tau_max, Streams(seed))


def shown(found: Gauges, torque: np.ndarray) -> np.ndarray:
    return found.read(torque, np.tile(Q, (len(torque), 1)))


def test_gains_are_uniform_within_their_half_width() -> None:
    ones = np.ones((1, 7))
    gains = np.array([shown(gauges(seed, gain_max=0.02), ones)[0] for seed in range(300)]) - 1.0
    assert np.abs(gains).max() <= 0.02
    assert gains.std() == pytest.approx(0.02 / np.sqrt(3), rel=0.06)
    assert np.mean(np.abs(gains) < 0.01) == pytest.approx(0.5, abs=0.04), "flat"


def test_crosstalk_reads_other_joints_torques() -> None:
    pure = np.eye(7) * 10.0
    leaks = np.array([shown(gauges(seed, crosstalk=0.01), pure) for seed in range(60)])
    own = np.diagonal(leaks, axis1=1, axis2=2)
    assert own == pytest.approx(np.full((60, 7), 10.0))
    assert leaks[:, ~np.eye(7, dtype=bool)].std() == pytest.approx(0.1, rel=0.06)


def test_curvature_is_quadratic_and_a_share_of_the_range() -> None:
    found = gauges(nonlinearity_max={"fixed": 1e-3}, range=50.0)
    torque = np.array([[0.0], [25.0], [50.0], [-50.0]]) * np.ones(7)
    off = (shown(found, torque) - torque)[:, 0]
    assert off == pytest.approx([0.0, 0.0125, 0.05, 0.05])


@pytest.mark.parametrize("swing", [4.0, 20.0])
def test_hysteresis_opens_a_loop_as_wide_as_its_share_of_the_swing(swing: float) -> None:
    found = gauges(hysteresis=0.01)
    up = np.linspace(0.0, swing, 200)
    cycle = np.concatenate([up, up[::-1], up, up[::-1]])
    out = shown(found, np.outer(cycle, np.ones(7)))[:, 0]
    loading, unloading = out[400:600], out[600:800][::-1]
    assert np.abs(unloading - loading).max() == pytest.approx(0.01 * swing, rel=0.45)
    assert loading[0] == pytest.approx(out[-1], abs=1e-9), "closed"


def test_ripple_repeats_with_its_cycles_in_a_turn() -> None:
    found = gauges(ripple={"size": 0.05, "cycles": 50})
    angles = np.linspace(0.0, 2 * np.pi, 2000, endpoint=False)
    out = found.read(np.zeros((2000, 7)), np.outer(angles, np.ones(7)))
    assert out.std(0) == pytest.approx(np.full(7, 0.05), rel=1e-3)
    assert np.abs(np.fft.rfft(out[:, 0])).argmax() == 50


def test_ripple_has_a_second_harmonic_and_cycles_of_each_joint() -> None:
    cycles = np.array([30, 30, 30, 30, 20, 20, 20])
    found = gauges(ripple={"size": 0.05, "second": 0.02, "cycles": cycles.tolist()})
    angles = np.linspace(0.0, 2 * np.pi, 2000, endpoint=False)
    out = found.read(np.zeros((2000, 7)), np.outer(angles, np.ones(7)))
    waves = np.abs(np.fft.rfft(out, axis=0)) / 1000 / np.sqrt(2)
    assert waves[cycles, range(7)] == pytest.approx(np.full(7, 0.05))
    assert waves[2 * cycles, range(7)] == pytest.approx(np.full(7, 0.02))


@pytest.mark.parametrize(
    ("ratio", "gain"),
    [pytest.param(0.1, 1.01, marks=pytest.mark.long), (1.0, 2.5), (3.0, 0.106)],
)
def test_a_resonance_amplifies_ripple_at_its_frequency(ratio: float, gain: float) -> None:
    resonance = {"frequency": 10.0, "damping": 0.2}
    found = gauges(ripple={"size": 0.05, "cycles": 240, "resonance": resonance})
    angles = 2 * np.pi / 240 * 10.0 * ratio * PERIOD * np.arange(4000)
    out = found.read(np.zeros((4000, 7)), np.outer(angles, np.ones(7)))
    assert out[2000:].std(0) == pytest.approx(np.full(7, 0.05 * gain), rel=0.12)


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


def test_drift_without_a_time_constant_is_a_random_walk() -> None:
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
