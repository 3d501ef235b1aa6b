"""robot.yaml: what was measured of one very arm, and what becomes of it."""

from __future__ import annotations

import datetime
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

import palpate as pp
from palpate.common.errors import InputError
from palpate.common.pose import Array, Pose
from palpate.estimation.wrench_observation import gain_root
from palpate.robots.nominal import NominalArm
from palpate.robots.owner import apply_calibration, load_description, measured_arm
from palpate.robots.robot_config import (
    Lean,
    RobotConfig,
    SensorGains,
    Value,
    read_config,
    write_config,
)
from palpate.robots.simulated.robot import MujocoRobot
from palpate.runs.settings import Settings, request_json, settings_from
from palpate.scene.poses import Poses, add_arm_camera

ARM = load_description()
DOWN = np.array([0.0, 0.0, -9.81])
EVERYTHING = """
palpate_robot: 1
name: Fritz
arm: fr3
gravity: {value: 9.8123}
torque_gain: {value: [0, 1e-2, 0, -1e-2, 0, 0, 0], std: 1e-3 1e-3}
tip_offset: {value: 0.0095, std: 5e-5, date: 2026-11-20, by: a gauge of 50 mm}
base_lean: {value: [1e-3, -5e-4], std: [1e-4, 1e-4]}
pose_repeatability: {value: 2e-5}
tip_compliance: {value: 2e-5, std: 5e-6}
end_effector: {mass: 0.8, centre: [0, 0, 0.05]}
stiffness: {translation: 800, rotation: 60, joints: [600, 600, 600, 600, 250, 150, 50]}
reflex:
  free: {force: 10, torque: 5}
  carrying: {force: 20, torque: 6}
  probing: {force: 40, torque: 10}
  contact: {force: 40, torque: 10}
workspace: {min: [0.2, -0.5, -0.1], max: [0.7, 0.5, 2.0]}
speed: 0.5
camera: {pos: [1.2, 0, 0.8], quat: [0.6, 0.37, 0.37, 0.6], fovy: 45, size: [640, 480]}
""".replace("std: 1e-3 1e-3", "std: [1e-2, 1e-3, 1e-2, 1e-3, 1e-2, 1e-2, 1e-2]")


def written(folder: Path, text: str = EVERYTHING) -> Path:
    path = folder / "robot.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_camera_of_the_arm_is_used_if_no_poses_have_one(tmp_path: Path) -> None:
    arm = apply_calibration(ARM, read_config(written(tmp_path)))
    base = Pose.of((0.0, 0.5, 0.7), (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)))
    camera = add_arm_camera(Poses(), arm, base).camera
    assert camera is not None
    assert camera.pos == pytest.approx((0.0, 1.7, 1.5), abs=2e-3)  # the base leans by a mrad
    assert (camera.fovy, camera.size) == (45.0, (640, 480))
    own = Poses(camera=camera.model_copy(update={"fovy": 60.0}))
    assert add_arm_camera(own, arm, base) is own
    assert add_arm_camera(Poses(), ARM, base).camera is None


@pytest.mark.parametrize("quat", ["[0, 0, 0, 0]", "[1, 0, 0]", "up"])
def test_a_camera_that_looks_nowhere_is_bad_input(tmp_path: Path, quat: str) -> None:
    text = f"camera: {{pos: [1, 0, 1], quat: {quat}, fovy: 45, size: [640, 480]}}"
    with pytest.raises(InputError, match="quaternion"):
        read_config(written(tmp_path, text))


def test_reflexes_that_a_robot_yaml_leaves_out_stay_as_described(tmp_path: Path) -> None:
    config = read_config(written(tmp_path, "reflex: {free: {force: 11, torque: 4}}"))
    own, described = apply_calibration(ARM, config).limits.reflexes, ARM.limits.reflexes
    assert (own.free.force, own.free.torque) == (11, 4)
    assert (own.carrying, own.probing, own.contact) == (
        described.carrying,
        described.probing,
        described.contact,
    )


def test_measured_figures_come_before_the_datasheets(tmp_path: Path) -> None:
    arm = pp.load("<mujoco><worldbody/></mujoco>", robot_config=written(tmp_path)).arm
    hand, limits = arm.nominal, arm.limits
    assert (hand.tip_offset, hand.tip_offset_std) == (0.0095, 5e-5)
    assert (hand.tip_compliance, hand.tip_compliance_std) == (2e-5, 5e-6)
    assert hand.pose_repeatability == 2e-5
    assert hand.force_repeatability == ARM.nominal.force_repeatability, "not measured"
    assert arm.gravity == 9.8123
    assert arm.stiffness.translation == 800
    assert limits.reflexes.free.force == 10
    assert limits.workspace_min.tolist() == [0.2, -0.5, -0.1]
    assert limits.workspace_max[2] == ARM.limits.workspace_max[2], "no farther than the arm's own"
    assert arm.pace.speed == 0.5 * ARM.pace.speed
    assert arm.pace.cautious.speed == 0.5 * ARM.pace.cautious.speed


def test_the_same_file_is_the_same_arm(tmp_path: Path) -> None:
    path = written(tmp_path)
    one, other = (pp.load("<mujoco><worldbody/></mujoco>", robot_config=path) for _ in range(2))
    assert one.arm is other.arm


def test_a_weighed_hand_is_in_the_nominal_arm(tmp_path: Path) -> None:
    arm = apply_calibration(ARM, read_config(written(tmp_path)))
    config = replace_mass(read_config(written(tmp_path)), 0.9)
    here = ARM.home[None]
    light, heavy = (
        NominalArm(one, Pose.of([0, 0, 0]), DOWN).kinematics(here).gravity_torque[0]
        for one in (arm, apply_calibration(ARM, config))
    )
    lever = NominalArm(ARM, Pose.of([0, 0, 0]), DOWN).jacobian(ARM.home)[2]
    assert heavy - light == pytest.approx(0.1 * 9.81 * lever, abs=0.02)


def replace_mass(config: RobotConfig, mass: float) -> RobotConfig:
    assert config.end_effector is not None
    return config.model_copy(
        update={"end_effector": config.end_effector.model_copy(update={"mass": mass})}
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("speeed: 0.5", ("unknown key 'speeed'", "speed")),
        ("speed: 1.5", ("'speed'", "1")),
        ("gravity: 9.81", ("gravity",)),
        ("gravity: {value: -9.81}", ("gravity.value", "greater than 0")),
        ("tip_offset: {value: 0.009}", ("'tip_offset.std' is missing",)),
        ("tip_offset: {value: yes, std: 1e-4}", ("tip_offset.value", "give a number")),
        ("torque_gain: {value: [0, 0]}", ("torque_gain.value", "7 numbers")),
        ("torque_gain: {value: [0, 0, 0, 0, 0, 0, 0]}", ("'std' or 'covariance'",)),
        (
            "torque_gain: {value: [0, 0, 0, 0, 0, 0, 0], covariance: [[1]]}",
            ("torque_gain.covariance", "a covariance"),
        ),
        ("torque_gain: {value: [-1, 0, 0, 0, 0, 0, 0], std: [0, 0, 0, 0, 0, 0, 0]}", ("relative",)),
        ("arm: iiwa14", ("was measured of the arm 'iiwa14', not of 'fr3'",)),
        ("palpate_robot: 2", ("palpate_robot",)),
        ("- 1", ("give the keys of a robot.yaml",)),
        ("a: [", ("not YAML",)),
    ],
)
def test_an_invalid_robot_yaml_is_refused_with_its_key(
    tmp_path: Path, text: str, words: tuple[str, ...]
) -> None:
    path = written(tmp_path, text)
    with pytest.raises(InputError) as told:
        Settings(scene=tmp_path / "scene.xml", robot_config=path).check_values()
    assert str(path) in str(told.value)
    for word in words:
        assert word in str(told.value)


def test_a_missing_robot_yaml_is_named() -> None:
    with pytest.raises(InputError, match=r"cannot read nowhere\.yaml"):
        Settings(scene=Path("scene.xml"), robot_config=Path("nowhere.yaml")).check_values()


def test_a_written_robot_yaml_reads_the_same(tmp_path: Path) -> None:
    config = read_config(written(tmp_path))
    write_config(tmp_path / "new" / "robot.yaml", config)
    again = read_config(tmp_path / "new" / "robot.yaml")
    assert again is not config
    assert (
        again.tip_offset
        == config.tip_offset
        == Value(value=0.0095, std=5e-5, date=datetime.date(2026, 11, 20), by="a gauge of 50 mm")
    )
    assert again.torque_gain is not None
    assert again.torque_gain.value.tolist() == [0, 1e-2, 0, -1e-2, 0, 0, 0]
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["robot.yaml"]


def test_a_request_states_its_robot_config(tmp_path: Path) -> None:
    path = written(tmp_path)
    settings = Settings(request="the mass of the cup", robot_config=path)
    assert settings_from(request_json(settings)).robot_config == path


def test_another_embedded_arm_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, "simulated: {noise: lab, seed: 3}")
    scene = """<mujoco><worldbody><site name="robot_base"/>
      <body name="table" pos="0.5 0 ?"><geom type="box" size=".2 .2 .02"/></body>
    </worldbody></mujoco>"""
    with pytest.raises(InputError, match=r"embedded arm of noise lab, seed 3.*seed 4"):
        pp.run(scene, robot_config=path, seed=4)


# The embedded robot.


def robot(arm: object, folder: Path, hidden: str) -> MujocoRobot:
    path = folder / "noise.yaml"
    path.write_text(hidden, encoding="utf-8")
    world = mujoco.MjSpec.from_string("<mujoco><worldbody/></mujoco>")
    return MujocoRobot(world, Pose.of([0, 0, 0]), arm, noise=str(path))  # type: ignore[arg-type]


def felt(arm: MujocoRobot) -> Array:
    """(7,) N m that the joints feel of nothing, elsewhere than where they were zeroed."""
    arm.move_joints(ARM.home + np.array([0, 0.3, 0, 0.6, 0, 0, 0]))
    arm.advance(3.0)
    arm.drain()
    arm.advance(0.2)
    return arm.drain().tau_ext.mean(axis=0)


def test_measured_gains_are_corrected(tmp_path: Path) -> None:
    gains = [0.0, 0.03, 0.0, -0.02, 0.0, 0.0, 0.0]
    hidden = f"torque: {{gain_max: {{fixed: {gains}}}}}"
    config = RobotConfig(torque_gain=SensorGains(value=np.array(gains), std=np.full(7, 1e-4)))
    plain = felt(robot(ARM, tmp_path, hidden))
    right = felt(robot(apply_calibration(ARM, config), tmp_path, hidden))
    assert np.abs(plain).max() > 0.1
    assert np.abs(right).max() < 5e-3


def test_estimators_know_the_gains_remaining_errors() -> None:
    rng = np.random.default_rng(0)
    root = 1e-3 * rng.standard_normal((7, 7))
    config = RobotConfig(torque_gain=SensorGains(value=np.full(7, 0.25), covariance=root @ root.T))
    hand = apply_calibration(ARM, config).nominal
    left = gain_root(hand, 7)
    assert left @ left.T == pytest.approx(root @ root.T / 1.25**2)
    assert hand.torque_gain == pytest.approx(np.sqrt(3 * (left @ left.T).diagonal().max()))
    uniform = gain_root(ARM.nominal, 7)
    assert uniform == pytest.approx(ARM.nominal.torque_gain / np.sqrt(3) * np.eye(7))
    assert gain_root(hand, 6) == pytest.approx(hand.torque_gain / np.sqrt(3) * np.eye(6))


def test_the_world_keeps_its_truth_under_a_wrong_robot_yaml(tmp_path: Path) -> None:
    hidden = "model: {tip_offset: {fixed: 3e-4}}"
    config = RobotConfig(tip_offset=Value(value=0.02, std=1e-5))
    plain, believed = (
        robot(arm, tmp_path, hidden) for arm in (ARM, apply_calibration(ARM, config))
    )
    assert believed.hand.tip_offset == 0.02
    assert believed.world.model.geom_pos == pytest.approx(plain.world.model.geom_pos)


def test_a_measured_lean_is_in_the_reported_pose(tmp_path: Path) -> None:
    """dz = r_x y - r_y x, of a base at the origin; the hand is half a metre ahead."""
    config = RobotConfig(base_lean=Lean(value=np.array([0.0, 2e-3]), std=np.zeros(2)))
    plain, leaning = (
        robot(arm, tmp_path, "name: perfect") for arm in (ARM, apply_calibration(ARM, config))
    )
    here, there = plain.state.pose_world_tcp.position, leaning.state.pose_world_tcp.position
    assert there[2] - here[2] == pytest.approx(-2e-3 * here[0], rel=1e-2)
    leaning.advance(0.5)
    assert np.abs(leaning.drain().wrench[-1]).max() < 0.2, "held up as it is"


def test_a_prediction_uses_the_measured_figures(tmp_path: Path) -> None:
    arm = measured_arm(apply_calibration(ARM, read_config(written(tmp_path))))
    assert arm.tip == 0.0095
    assert np.abs(felt(robot(arm, tmp_path, "name: perfect"))).max() < 5e-3


def test_another_visit_is_the_same_robot_with_other_noise(tmp_path: Path) -> None:
    (tmp_path / "noise.yaml").write_text("torque: {gain_max: 0.05, white: 0.1}")
    readings: list[Array] = []
    for visit in (0, 1):
        world = mujoco.MjSpec.from_string("<mujoco><worldbody/></mujoco>")
        arm = MujocoRobot(
            world, Pose.of([0, 0, 0]), ARM, noise=str(tmp_path / "noise.yaml"), visit=visit
        )
        readings.append(felt(arm))
    assert readings[0] == pytest.approx(readings[1], abs=0.1), "the same gains"
    assert np.abs(readings[0]).max() > 0.2
    assert not np.allclose(readings[0], readings[1], atol=1e-3)


def test_an_empty_robot_yaml_leaves_the_arm_as_described(tmp_path: Path) -> None:
    arm = apply_calibration(ARM, read_config(written(tmp_path, "name: Fritz")))
    assert replace(arm, config=None, described=None).nominal == ARM.nominal
