"""Sensors of the arm: joint encoders, and joint torque sensors."""

from __future__ import annotations

import numpy as np
import pytest
from noises import HOME, JACOBIAN, model, moving, read, sensors

from palpate.robots.nominal import wrench
from palpate.robots.simulated.noise.disturbances import Rests
from palpate.robots.simulated.noise.model import Streams
from palpate.robots.simulated.noise.models import noise_models
from palpate.robots.simulated.noise.sensors import Encoders

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


def test_equal_seeds_give_equal_signals() -> None:
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


def test_the_reflex_has_the_noise_of_single_samples() -> None:
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


def encoders(seed: int = 0, **sections: object) -> Encoders:
    noise, streams = model(**sections), Streams(seed)
    return Encoders(noise, Rests(noise.sticking, noise.pose, 0.005, streams), streams)


Q = np.linspace(-1.0, 1.0, 7)[None]


def test_perfect_encoders_report_true_angles() -> None:
    found = encoders()
    assert found.exact
    assert found.clean
    assert found.reported(Q, np.full((1, 7), 20.0)) is Q
    assert not found.pose_error.any()


def test_joints_give_way_behind_the_encoders() -> None:
    found = encoders(model={"joint_compliance": {"fixed": 1e-4}})
    off = found.reported(Q, np.full((1, 7), 20.0)) - Q
    assert off == pytest.approx(np.full((1, 7), 2e-3))


def test_compliance_is_never_negative() -> None:
    drawn = [
        encoders(seed, model={"joint_compliance": 1e-4}).reported(Q, np.ones((1, 7))) - Q
        for seed in range(100)
    ]
    assert np.min(drawn) >= 0
    assert np.sqrt(np.mean(np.square(drawn))) == pytest.approx(1e-4, rel=0.1)


def test_ripple_repeats_around_a_turn() -> None:
    found = encoders(pose={"encoder_ripple": {"size": 1e-4, "cycles": 8}})
    turn = np.outer(np.linspace(0, 2 * np.pi, 800, endpoint=False), np.ones(7))
    off = found.reported(turn, np.zeros((800, 7))) - turn
    assert off.std(0) == pytest.approx(np.full(7, 1e-4), rel=1e-3)


def test_noise_is_that_of_a_mean_of_five_samples() -> None:
    noise = encoders(pose={"encoder": 1e-5}).noise(4000)
    assert noise is not None
    assert noise.std() == pytest.approx(1e-5 / np.sqrt(5), rel=0.03)


def test_angles_come_in_steps() -> None:
    found = encoders(pose={"quantisation": 0.01})
    assert found.quantise_angles(np.array([[0.123]])) == pytest.approx(np.array([[0.12]]))


def test_the_arm_goes_on_while_its_pads_give_way() -> None:
    found = encoders(model={"pad_compliance": {"fixed": 1e-4}})
    down = np.array([0.0, 0.0, -1.0])
    more = found.pressed(JACOBIAN, np.full(100, 10.0), down)
    assert (JACOBIAN @ more[-1])[:3] == pytest.approx(1e-3 * down, abs=1e-7)
    assert (JACOBIAN @ more[-1])[3:] == pytest.approx(np.zeros(3), abs=1e-7)
    assert np.linalg.norm(more[3]) == pytest.approx(0.632 * np.linalg.norm(more[-1]), rel=0.01)
    pulled = found.pressed(JACOBIAN, np.full(100, -10.0), down)
    assert np.abs(pulled[-1]).max() < 1e-8, "pulling does not"


def test_links_warm_up_and_cool_down() -> None:
    errors: list[np.ndarray] = []
    for seed in range(200):
        found = encoders(seed, pose={"thermal": 1e-4})
        errors.append(found.pose_error.copy())
    assert np.std(errors) == pytest.approx(1e-4, rel=0.1)
    found.pass_time(60_000)
    assert (found.pose_error != errors[-1]).all()
