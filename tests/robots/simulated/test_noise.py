"""Sensor worlds: each imperfection does what its figure says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from palpate.geometry.pose import Pose
from palpate.robots.nominal import NominalArm, wrench
from palpate.robots.registry import load_description
from palpate.robots.simulated.noise import Imperfections, Sensors, perturb_links
from palpate.robots.simulated.noise_models import noise_models
from palpate.robots.simulated.robot import MujocoRobot
from palpate.settings import Settings

PERIOD, BLOCK = 0.005, 5
ARM = load_description()
NONE = noise_models().imperfections("none", ARM)
STILL = np.zeros((4, 7))


def sensors(kinds: Imperfections, seed: int = 0) -> Sensors:
    return Sensors(kinds, PERIOD, BLOCK, np.random.default_rng(seed))


@pytest.fixture(scope="module")
def jacobian() -> np.ndarray:
    return (
        NominalArm(ARM, Pose.of([0, 0, 0]), np.array([0, 0, -9.81]))
        .kinematics(ARM.home[None])
        .jacobian[0]
    )


def test_none_is_perfect(jacobian: np.ndarray) -> None:
    torque = np.arange(28.0).reshape(4, 7)
    assert (sensors(NONE).measure(torque, STILL + 0.3, jacobian) == torque).all()
    assert (sensors(NONE).pose_error == 0).all()


def test_white_noise_is_that_of_a_mean_of_five_samples(jacobian: np.ndarray) -> None:
    kinds = Imperfections(
        torque_noise=noise_models().imperfections("lab", ARM).torque_noise, friction=np.zeros(7)
    )
    measured = sensors(kinds).measure(np.zeros((4000, 7)), np.zeros((4000, 7)), jacobian)
    assert measured.std(0) == pytest.approx(kinds.torque_noise / np.sqrt(5), rel=0.06)


def test_friction_opposes_motion_and_turns_round_within_the_presliding_distance(
    jacobian: np.ndarray,
) -> None:
    kinds = Imperfections(torque_noise=np.full(7, 1e-12), friction=np.full(7, 0.1))
    s = sensors(kinds)
    forth = s.measure(np.zeros((100, 7)), np.full((100, 7), 0.1), jacobian)
    back = s.measure(np.zeros((100, 7)), np.full((100, 7), -0.1), jacobian)
    assert forth[-1] == pytest.approx(np.full(7, 0.1), rel=1e-3)
    assert back[-1] == pytest.approx(np.full(7, -0.1), rel=1e-3)
    halfway = int(kinds.presliding / (0.1 * PERIOD))
    assert (np.abs(back[halfway - 1]) < 0.06).all()
    held = s.measure(STILL, STILL, jacobian)
    assert held == pytest.approx(np.broadcast_to(back[-1], (4, 7)), abs=1e-9), (
        "it stays where motion stopped"
    )


def test_each_rest_is_a_new_force_error_of_the_datasheets_size(jacobian: np.ndarray) -> None:
    kinds = replace(NONE, torque_noise=np.full(7, 1e-12), repeatability=0.15)
    s = sensors(kinds)
    forces = []
    for _ in range(300):
        s.measure(np.zeros((20, 7)), np.full((20, 7), 0.3), jacobian)
        rest = s.measure(np.zeros((200, 7)), np.zeros((200, 7)), jacobian)
        assert np.ptp(rest[-10:], axis=0).max() < 1e-6, "constant while the arm rests"
        forces.append(wrench(jacobian, rest[-1]))
    forces = np.array(forces)
    assert forces[:, :3].std(0) == pytest.approx(np.full(3, 0.15), rel=0.12)
    assert np.abs(forces[:, 3:]).max() < 1e-6


def test_motion_shakes_the_force_error_off(jacobian: np.ndarray) -> None:
    s = sensors(replace(NONE, torque_noise=np.full(7, 1e-12), repeatability=0.15))
    rest = s.measure(np.zeros((200, 7)), np.zeros((200, 7)), jacobian)[-1]
    sliding = s.measure(np.zeros((40, 7)), np.full((40, 7), 0.02), jacobian)[-1]
    assert np.abs(sliding).max() < 0.05 * np.abs(rest).max()


def test_the_reported_pose_changes_only_with_motion(jacobian: np.ndarray) -> None:
    kinds = replace(
        NONE, torque_noise=np.full(7, 1e-12), repeatability=0.15, pose_repeatability=1e-4
    )
    s = sensors(kinds)
    s.measure(np.zeros((200, 7)), np.zeros((200, 7)), jacobian)
    before = s.pose_error.copy()
    s.measure(np.zeros((200, 7)), np.zeros((200, 7)), jacobian)
    assert (s.pose_error == before).all()
    errors = []
    for _ in range(200):
        s.measure(np.zeros((100, 7)), np.full((100, 7), 0.3), jacobian)
        s.measure(np.zeros((100, 7)), np.zeros((100, 7)), jacobian)
        errors.append(s.pose_error.copy())
    assert np.std(errors, axis=0) == pytest.approx(np.full(3, 1e-4), rel=0.2)


def test_zeroing_takes_out_what_the_gain_does_at_that_torque(jacobian: np.ndarray) -> None:
    s = sensors(replace(NONE, torque_noise=np.full(7, 1e-12), gain=0.01))
    weight = np.full(7, 20.0)
    s.zero(weight, weight)
    assert s.measure(STILL + weight, STILL, jacobian) == pytest.approx(STILL + weight, abs=1e-9)
    elsewhere = s.measure(STILL + 2 * weight, STILL, jacobian)[0] - 2 * weight
    assert np.abs(elsewhere).max() <= 0.01 * 20.0
    assert np.abs(elsewhere).max() > 0.01


def test_same_seed_same_signal(jacobian: np.ndarray) -> None:
    kinds = noise_models().imperfections("datasheet", ARM)
    signal = [sensors(kinds, seed=5).measure(STILL, STILL + 0.1, jacobian) for _ in range(2)]
    assert (signal[0] == signal[1]).all()


@pytest.mark.parametrize("noise", ["none", "datasheet"])
def test_native_compensation_holds_the_nominal_weight_whatever_the_true_one(noise: str) -> None:
    robot = ARM.spec()
    kinds = noise_models().imperfections(noise, ARM)
    perturb_links(robot, ARM.links, kinds, np.random.default_rng(1))
    model = robot.compile()
    data = mujoco.MjData(model)
    data.qpos[:7] = ARM.home
    mujoco.mj_forward(model, data)
    nominal = NominalArm(ARM, Pose.of([0, 0, 0]), np.array([0, 0, -9.81])).kinematics(
        ARM.home[None]
    )
    assert data.qfrc_gravcomp[:7] == pytest.approx(nominal.gravity_torque[0], abs=1e-9)
    error = np.abs(data.qfrc_bias[:7] - nominal.gravity_torque[0]).max()
    assert error < 1e-9 if noise == "none" else 0.01 < error < 1.0


NOISY = """
from palpate.robots.simulated.noise import Imperfections
from palpate.robots.simulated.noise_models import NoiseModel, perfect
import numpy as np

def worn(arm):
    return Imperfections(10 * arm.sensors.torque_noise, np.full(7, 0.5))

bench = NoiseModel("worn", worn)
none = NoiseModel("none", worn)
"""
"""All there is to a noise model of one's own: one file, and an entry point."""


def test_a_noise_model_of_ones_own_is_one_file_and_an_entry_point(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    info = tmp_path / "noisy-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: noisy\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[palpate.noise]\nworn = noisy_bench\n")
    (tmp_path / "noisy_bench.py").write_text(NOISY)
    monkeypatch.syspath_prepend(tmp_path)
    noise_models.cache_clear()
    try:
        assert list(noise_models().models) == ["none", "lab", "datasheet", "worn"]
        kinds = noise_models().imperfections("worn", ARM)
        assert kinds.torque_noise == pytest.approx(10 * ARM.sensors.torque_noise)
        assert not noise_models().imperfections("none", ARM).friction.any(), "ours stays ours"
        noisy = MujocoRobot(empty(), Pose.of([0, 0, 0]), ARM, noise="worn")
        noisy.advance(0.5)
        assert noisy.drain().tau_ext.std(0).max() > 0.1
        assert Settings(scene=Path("scene.xml"), noise="worn").checked().noise == "worn"
    finally:
        noise_models.cache_clear()


def empty() -> mujoco.MjSpec:
    return mujoco.MjSpec.from_string("<mujoco><worldbody/></mujoco>")
