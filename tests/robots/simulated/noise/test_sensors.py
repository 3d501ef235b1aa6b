"""Joint torque signals: each imperfection does what its figure says."""

from __future__ import annotations

import numpy as np
import pytest
from noises import HOME, JACOBIAN, model, moving, read, sensors

from palpate.robots.nominal import wrench
from palpate.robots.simulated.noise.models import noise_models

LAB = noise_models().load("lab")


def test_none_is_perfect() -> None:
    torque = np.arange(28.0).reshape(4, 7)
    measured = sensors(noise_models().load("none")).measure(torque, moving(4, 0.3))
    assert measured.torque == pytest.approx(torque, abs=1e-12)
    assert measured.arrived is None


def test_zeroing_takes_out_what_the_gain_does_at_that_torque() -> None:
    found = sensors(model(torque={"gain_max": 0.01}))
    weight = np.full(7, 20.0)
    found.zero(weight, weight, moving(1))
    here = found.measure(np.tile(weight, (4, 1)), moving(4)).torque
    assert here == pytest.approx(np.tile(weight, (4, 1)), abs=1e-9)
    elsewhere = found.measure(np.tile(2 * weight, (4, 1)), moving(4)).torque[0] - 2 * weight
    assert 0.01 < np.abs(elsewhere).max() <= 0.01 * 20.0


def test_zeroing_leaves_what_the_offset_says() -> None:
    left: list[np.ndarray] = []
    for seed in range(200):
        found = sensors(model(torque={"offset": 0.2}, friction={"coulomb": 0.5}), seed)
        found.zero(np.full(7, 3.0), np.full(7, 1.0), moving(1))
        left.append(read(found, 2, torque=3.0)[0] - 1.0)
    assert np.std(left) == pytest.approx(0.2, rel=0.08)


def test_same_seed_same_signal() -> None:
    hardware = noise_models().load("hardware")
    signals = [read(sensors(hardware, seed=5), 40, 0.1) for _ in range(2)]
    assert (signals[0] == signals[1]).all()
    assert (read(sensors(hardware, seed=6), 40, 0.1) != signals[0]).all()


def test_a_change_of_one_section_reshuffles_no_other() -> None:
    plain = {"torque": {"gain_max": 0.01}, "friction": {"coulomb": 0.1}}
    more = {**plain, "sticking": {"force": 1.0}, "pose": {"repeatability": 1e-4}}
    few, many = sensors(model(**plain), 3), sensors(model(**more), 3)
    assert read(few, 20, 0.5) == pytest.approx(read(many, 20, 0.5), abs=1e-12)


def test_a_fixed_value_is_that_very_value_for_every_seed() -> None:
    gains = [0.01, -0.01, 0.0, 0.0, 0.0, 0.0, 0.02]
    for seed in range(3):
        found = sensors(model(torque={"gain_max": {"fixed": gains}}), seed)
        assert read(found, 1, torque=10.0)[0] == pytest.approx(10.0 * (1 + np.array(gains)))


def test_what_the_arm_feels_at_once_has_the_noise_of_single_samples() -> None:
    looks = sensors(LAB).looks(4000)
    assert looks.std(0) == pytest.approx(LAB.torque.white, rel=0.06)


def test_a_cable_pulls_smoothly_with_its_size_and_not_where_it_was_zeroed() -> None:
    apart, size = np.linspace(0.0, 0.6, 61), 0.5
    line = np.array([0.4, 0.0, 0.4]) + np.outer(apart, [0.0, 1.0, 0.0])
    pulls = []
    for seed in range(150):
        found = sensors(model(model={"payload_cable": size}), seed)
        found.zero(HOME.gravity_torque[0], HOME.gravity_torque[0], moving(1, 0.0, line[:1]))
        weight = np.tile(HOME.gravity_torque[0], (61, 1))
        felt = found.measure(weight, moving(61, 0.0, line)).torque - weight
        pulls.append([wrench(JACOBIAN, row)[:3] for row in felt])
    change = np.array(pulls)
    assert np.abs(change[:, 0]).max() < 1e-9, "zeroed there"
    for row, expected in ((10, 0.1), (30, 0.3), (60, 0.6)):
        spread = size * np.sqrt(2 * (1 - np.exp(-((expected / 0.3) ** 2) / 2)))
        assert change[:, row].std() == pytest.approx(spread, rel=0.12)


def test_a_shaking_base_makes_arm_and_load_heavier_and_lighter() -> None:
    shaken = model(environment={"vibration": {"acceleration": 0.2, "frequency": 10.0}})
    felt = read(sensors(shaken), 2000, torque=9.81) - 9.81
    assert felt.std() == pytest.approx(0.2, rel=0.02)
    power = np.abs(np.fft.rfft(felt[:, 0]))
    assert np.fft.rfftfreq(2000, 0.005)[power.argmax()] == pytest.approx(10.0)
