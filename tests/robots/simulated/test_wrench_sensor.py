"""Six-axis sensor between flange and hand: what it measures in the simulated arm, and with which errors."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from palpate.common.errors import InputError
from palpate.common.pose import Array, Pose, rotations
from palpate.robots.owner import load_description
from palpate.robots.sheet import WristSheet
from palpate.robots.simulated.noise.model import Streams, WristErrors
from palpate.robots.simulated.noise.sensors import WristSensor
from palpate.robots.simulated.robot import MujocoRobot
from palpate.trace.recording import WrenchSensor
from palpate.trace.samples import Samples

ARM = load_description("fr3-ft")
HAND = 0.73 + 2 * 0.015
G = 9.81


def robot(noise: str = "none", seed: int = 0, arm: str = "fr3-ft") -> MujocoRobot:
    world = mujoco.MjSpec.from_string("<mujoco><worldbody/></mujoco>")
    return MujocoRobot(world, Pose.of([0, 0, 0]), load_description(arm), noise, seed)


def logged(found: MujocoRobot, seconds: float) -> Samples:
    found.advance(seconds)
    return found.drain()


def test_the_sensor_carries_the_hand_with_the_stated_sign() -> None:
    """At rest with the tool down its z axis points down: the hand needs a force of -m g along it."""
    samples = logged(robot(), 0.5)
    held = samples.wrench_sensor[-20:].mean(axis=0)
    axes = rotations(samples.pose_world_tcp[-1:, 3:])[0]
    np.testing.assert_allclose(axes @ held[:3], [0.0, 0.0, HAND * G], atol=0.02)
    # The moment is that of the hand's centre of mass, 10 mm beside the axis.
    np.testing.assert_allclose(held[3:5], [0.0, 0.73 * G * -0.01], atol=2e-3)


def test_the_sensor_reads_the_inertia_of_the_moving_hand() -> None:
    found = robot()
    found.move_joints(ARM.home + 0.5 * np.eye(7)[0], 0.5)
    samples = logged(found, 2.0)
    turned = rotations(samples.pose_world_tcp[:, 3:])
    force = np.einsum("nij,nj->ni", turned, samples.wrench_sensor[:, :3])
    change = np.gradient(samples.twist[:, :3], samples.t, axis=0)
    fast = np.abs(change[:, 1]) > 0.3
    # The centre of the hand is not at the TCP, but moves nearly alike about the vertical.
    ratio = force[fast, 1] @ change[fast, 1] / (change[fast, 1] @ change[fast, 1])
    assert ratio == pytest.approx(HAND, rel=0.05)


def test_an_arm_without_a_sensor_has_none() -> None:
    assert logged(robot(arm="fr3"), 0.1).wrench_sensor.shape[1] == 0
    assert load_description("fr3").nominal.wrench_sensor is None


def test_the_sensor_lengthens_the_arm_and_stands_above_the_hand() -> None:
    plain, sensed = load_description("fr3").nominal.chain, ARM.nominal.chain
    assert plain is not None
    assert sensed is not None
    lower = np.subtract(sensed.tcp, plain.tcp)
    assert np.linalg.norm(lower) == pytest.approx(0.0254, abs=1e-6)
    assert sum(link.mass for link in sensed.links) == pytest.approx(
        sum(link.mass for link in plain.links) + 0.275
    )
    sensor = ARM.nominal.wrench_sensor
    assert isinstance(sensor, WrenchSensor)
    np.testing.assert_allclose(sensor.pose_tcp_sensor, [0, 0, -0.1034, 1, 0, 0, 0], atol=1e-9)
    np.testing.assert_allclose(ARM.pose_flange_tcp.position, [0, 0, 0.1034 + 0.0254], atol=1e-9)


SHEET = WristSheet(
    label="test",
    range=[100, 100, 200, 10, 10, 10],
    white=[0.2, 0.2, 0.4, 0.01, 0.01, 0.02],
    drift=[0.3, 0.3, 0.3, 0.02, 0.02, 0.02],
    gain=0.01,
    crosstalk=0.005,
)  # fmt: skip
LOAD = np.array([3.0, -4.0, 12.0, 0.5, -0.2, 0.1])


def read(seed: int = 0, rows: int = 4000, load: Array = LOAD, **errors: float) -> Array:
    return WristSensor(SHEET, WristErrors(**errors), Streams(seed)).read(np.tile(load, (rows, 1)))


def test_a_perfect_sensor_reads_the_wrench() -> None:
    np.testing.assert_allclose(read(rows=3), np.tile(LOAD, (3, 1)), atol=1e-12)


def test_white_noise_is_that_of_the_data_sheet_over_five_samples() -> None:
    std = read(white=1.0).std(axis=0)
    np.testing.assert_allclose(std, np.array(SHEET.white) / np.sqrt(5.0), rtol=0.06)


def test_the_gain_scales_all_axes_and_is_the_robots_own() -> None:
    ratios = np.array([read(seed, 1, gain=1.0)[0] / LOAD for seed in range(200)])
    np.testing.assert_allclose(ratios, ratios[:, :1] * np.ones(6), rtol=1e-9)
    assert ratios[:, 0].std() == pytest.approx(0.01, rel=0.15)
    np.testing.assert_array_equal(read(3, 1, gain=1.0), read(3, 1, gain=1.0))


def test_crosstalk_and_mounting_leave_the_size_and_change_the_axes() -> None:
    turned = read(1, 1, mounting=1.0)[0]
    assert np.linalg.norm(turned[:3]) == pytest.approx(13.0, rel=1e-3)
    assert not np.allclose(turned, LOAD, atol=1e-3)
    alone = read(1, 1, np.array([0.0, 0, 10, 0, 0, 0]), crosstalk=1.0)[0]
    assert alone[2] == pytest.approx(10.0)
    assert 0.0 < np.abs(alone[:2]).max() < 0.2


def test_the_zero_drifts_and_a_load_beyond_the_range_saturates() -> None:
    zeros = np.array([read(seed, 1, 0 * LOAD, drift=1.0)[0] for seed in range(200)])
    np.testing.assert_allclose(zeros.std(axis=0), SHEET.drift, rtol=0.2)
    assert read(rows=1, load=50.0 * LOAD)[0].tolist() == [100, -100, 200, 10, -10, 5]


def test_noise_of_the_arm_reaches_the_samples() -> None:
    quiet, noisy = (logged(robot(noise), 1.0).wrench_sensor[100:] for noise in ("none", "measured"))
    assert noisy[:, 2].std() > quiet[:, 2].std() + 0.05


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("range: [1, 2]", "give a list of 6 numbers"),
        ("gain: -1", "wrench_sensor.gain"),
        ("colour: red", "wrench_sensor.colour"),
    ],
)
def test_a_wrong_figure_of_a_sensor_is_named(tmp_path: Path, line: str, said: str) -> None:
    own = (ARM.mjcf.parents[1] / "fr3-ft" / "description.yaml").read_text(encoding="utf-8")
    name = line.partition(":")[0]
    head, _, sensor = own.partition("wrench_sensor:\n")
    kept = [row for row in sensor.splitlines() if not row.strip().startswith(f"{name}:")]
    text = f"{head}wrench_sensor:\n  {line}\n" + "\n".join(kept)
    (tmp_path / "description.yaml").write_text(text.replace("../fr3/arm.xml", str(ARM.mjcf)))
    with pytest.raises(InputError, match=said):
        load_description(str(tmp_path))
