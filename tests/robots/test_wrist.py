"""The external wrench by a six-axis sensor, and the arm with six axes that needs it."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

import palpate as pp
from palpate.common.errors import InputError
from palpate.common.pose import Pose
from palpate.robots.description import RobotDescription
from palpate.robots.kinematics import forward_kinematics, inverse_kinematics, too_far
from palpate.robots.nominal import NominalArm
from palpate.robots.owner import load_description
from palpate.robots.pace import mistaken_force
from palpate.robots.simulated.noise.models import noise_models
from palpate.robots.simulated.robot import MujocoRobot
from palpate.robots.springs import Swivel

UR5E = load_description("ur5e")
BASE = Pose.of([0, 0, 0])
SCENARIOS = Path(pp.__file__).parent / "studies" / "scenarios"
SPRING = 2e4  # N/m
SCALE = f"""<mujoco><worldbody><body name="plate" pos="0.45 0 0.1" gravcomp="1">
  <joint type="slide" axis="0 0 1" stiffness="{SPRING}" damping="200"/>
  <geom type="box" size="0.15 0.15 0.05" mass="2"/></body></worldbody></mujoco>"""


def robot(arm: str, noise: str = "none", world: str = "<mujoco/>") -> MujocoRobot:
    return MujocoRobot(mujoco.MjSpec.from_string(world), BASE, load_description(arm), noise, 0)


def test_the_ur5e_has_the_published_kinematics() -> None:
    """Universal Robots' DH parameters: d1, a2, a3, d4, d5, d6 in m, as standard DH transforms."""
    rows = [
        (0.1625, 0.0, np.pi / 2),
        (0.0, -0.425, 0.0),
        (0.0, -0.3922, 0.0),
        (0.1333, 0.0, np.pi / 2),
        (0.0997, 0.0, -np.pi / 2),
        (0.0996, 0.0, 0.0),
    ]
    q = np.array([0.3, -1.2, 1.4, -1.7, -1.4, 0.5])
    flange = Pose.turn([0, 0, np.pi])  # ROS's base_link against the controller's base
    for angle, (d, a, alpha) in zip(q, rows, strict=True):
        turned = Pose.turn([0, 0, angle]) @ Pose.of([a, 0, d])
        flange = flange @ turned @ Pose.turn([alpha, 0, 0])
    expected = flange @ Pose.of([0, 0, 0.15])
    found = forward_kinematics(UR5E, tuple(q.tolist()))
    assert found.distance_to(expected) < 1e-6
    assert found.angle_to(expected) < 1e-6


def test_the_ur5e_has_the_published_masses_and_limits() -> None:
    chain = UR5E.nominal.chain
    assert chain is not None
    masses = [link.mass for link in chain.links]
    assert masses[:6] == [3.761, 8.058, 2.846, 1.37, 1.3, 0.365]
    assert sum(masses[6:]) == pytest.approx(0.925)
    assert UR5E.limits.tau_max.tolist() == [150.0] * 3 + [28.0] * 3
    assert UR5E.hand.opening == 0.085
    assert UR5E.pose_flange_tcp.position[2] == pytest.approx(0.15)


@pytest.mark.parametrize("place", [(0.4, 0.2, 0.05), (0.6, -0.2, 0.1), (0.35, -0.3, 0.3)])
def test_six_joints_reach_with_the_tool_down(place: tuple[float, float, float]) -> None:
    goal = Pose.top_down(place, 0.7)
    nominal = NominalArm(UR5E, BASE, np.array([0.0, 0.0, -9.81]))
    for q in (inverse_kinematics(UR5E, goal, BASE), nominal.reach(goal, UR5E.home)):
        assert q is not None
        there = forward_kinematics(UR5E, tuple(q.tolist()))
        assert there.distance_to(goal) < 1e-3
        assert there.angle_to(goal) < np.radians(0.5)
    assert too_far(UR5E, Pose.top_down((1.1, 0.0, 0.1), 0.0))


def test_six_joints_have_no_null_space() -> None:
    swivel = Swivel.of(np.random.default_rng(0).normal(size=(6, 6)), np.ones(6))
    assert not swivel.axis.any()
    assert not swivel.torque(np.ones(6), np.ones((3, 6))).any()


@pytest.mark.parametrize("arm", ["fr3-ft", "ur5e"])
def test_the_wrench_in_free_motion_is_free_of_weight_and_inertia_of_the_hand(arm: str) -> None:
    found = robot(arm)
    home = load_description(arm).home
    turned = home.copy()
    turned[[0, -3, -1]] += [0.4, 0.3, 0.5]  # the hand tilts
    found.move_joints(turned, 1.0)
    found.advance(1.5)
    samples = found.drain()
    assert np.abs(samples.twist[:, :3]).max() > 0.1
    assert np.abs(samples.wrench[:, :3]).max() < 0.15
    assert np.abs(samples.wrench[:, 3:]).max() < 0.02


@pytest.mark.parametrize("arm", ["fr3-ft", "ur5e"])
def test_the_sensor_measures_the_force_of_a_contact(arm: str) -> None:
    found, described = robot(arm, "measured", SCALE), load_description(arm)
    nominal = NominalArm(described, BASE, np.array([0.0, 0.0, -9.81]))
    found.move_joints(nominal.reach(Pose.top_down((0.45, 0.0, 0.2), 0.0), described.home))
    found.advance(4.0)
    found.move_axis(np.array([0.0, 0.0, -1.0]), 0.02, 0.05)
    found.advance(4.0)
    # The truth: the plate's spring bears the force.
    force = SPRING * (found.world.true_poses(["plate"])["plate"].position[2] - 0.1)
    assert force < -8.0
    wrench = found.drain().wrench[-40:].mean(axis=0)
    assert wrench[2] == pytest.approx(force, rel=0.06, abs=0.5)


def test_a_sensor_hides_no_contact_that_joint_friction_would() -> None:
    """The least force that counts as a contact is the sensor's error, not the joints' friction."""
    assert mistaken_force(UR5E, UR5E.home) < 3.0
    assert mistaken_force(load_description("fr3"), load_description("fr3").home) > 3.0


@pytest.mark.parametrize("level", ["lab", "datasheet", "hardware", "measured"])
def test_a_noise_model_has_a_figure_for_each_of_six_joints(level: str) -> None:
    ours, fr3 = noise_models().load(level, UR5E), noise_models().load(level)
    assert ours.torque.white.shape == ours.torque.ripple.cycles.shape == (6,)
    assert ours.model.link_com.size.shape == (6, 3)
    assert ours.torque.crosstalk.size.shape == (6, 6)
    # The elbow takes the figure of the FR3's fourth joint, in the ratio of the descriptions.
    assert ours.friction.coulomb[2] == pytest.approx(fr3.friction.coulomb[3] * 0.15 / 0.06)


def own(folder: Path, arm: RobotDescription, **changes: str) -> str:
    """Write a description that is that of an arm with other lines."""
    folder.mkdir()
    source = arm.mjcf.parent
    (folder / "arm.xml").write_bytes(arm.mjcf.read_bytes())
    lines = (source / "description.yaml").read_text(encoding="utf-8").split("\n")
    text = "\n".join(changes.get(line.split(":")[0], line) for line in lines)
    (folder / "description.yaml").write_text(text, encoding="utf-8")
    return f"{folder}/"


def test_five_joints_are_refused(tmp_path: Path) -> None:
    five = "joints: [ur5e_shoulder_pan, ur5e_shoulder_lift, ur5e_elbow, ur5e_wrist_1, ur5e_wrist_2]"
    with pytest.raises(
        InputError, match="'joints' names 5; give an arm with 7 joints, or one with 6 and"
    ):
        load_description(own(tmp_path / "five", UR5E, joints=five))


def test_six_joints_without_a_sensor_are_refused(tmp_path: Path) -> None:
    folder = own(tmp_path / "bare", UR5E)
    file = Path(folder) / "description.yaml"
    text = file.read_text(encoding="utf-8")
    file.write_text(text[: text.index("\nwrench_sensor:")], encoding="utf-8")
    with pytest.raises(
        InputError, match=r"names 6; give .* 6 and a six-axis sensor.*wrench_sensor"
    ):
        load_description(folder)


def test_an_unknown_gripper_is_refused(tmp_path: Path) -> None:
    folder = own(tmp_path / "gripper", UR5E)
    file = Path(folder) / "description.yaml"
    text = file.read_text(encoding="utf-8").replace("body: ur5e_hand", "body: robotiq_2f140")
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"unknown body 'robotiq_2f140'; valid: .*ur5e_hand"):
        load_description(folder)


def test_a_list_of_another_arm_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"'home': give a list of 6 numbers, one a joint, not 5"):
        load_description(own(tmp_path / "short", UR5E, home="home: [0, -1.8, 1.7, -1.4, -1.57]"))
    text = (UR5E.mjcf.parent / "description.yaml").read_text(encoding="utf-8")
    assert "torque_noise" in text
    folder = own(tmp_path / "alike", UR5E)
    (Path(folder) / "description.yaml").write_text(
        text.replace("  torque_noise: [0.2, 0.2, 0.2, 0.08, 0.08, 0.08]\n", ""), encoding="utf-8"
    )
    with pytest.raises(InputError, match=r"'sensors.torque_noise': .* not 7; 'like' took it over"):
        load_description(folder)


def test_joint_torques_of_six_joints_are_not_read() -> None:
    with pytest.raises(InputError, match=r"'ur5e' has 6 joints.*wrench and the pose of its sensor"):
        pp.dynamics("none.csv", "ur5e")
    with pytest.raises(InputError, match="'ur5e' has 6 joints"):
        pp.noise("none.csv", "ur5e")


def test_lists_of_another_number_of_joints_are_refused(tmp_path: Path) -> None:
    scene = "<mujoco><worldbody><body name='b' pos='.5 0 .1'><freejoint/><geom size='.03'/></body></worldbody></mujoco>"
    (tmp_path / "poses.yaml").write_text("joints: {aside: [0, 0, 0, 0, 0, 0, 0]}", encoding="utf-8")
    with pytest.raises(InputError, match="'aside' has 7 angles, and the arm has 6 joints"):
        pp.load(scene, poses=tmp_path / "poses.yaml", arm="ur5e")
    (tmp_path / "robot.yaml").write_text(
        "palpate_robot: 1\ntorque_gain: {value: [0, 0, 0, 0, 0, 0, 0], std: [0, 0, 0, 0, 0, 0, 0]}",
        encoding="utf-8",
    )
    with pytest.raises(
        InputError, match=r"7 numbers in 'torque_gain.value', and the arm 'ur5e' has 6"
    ):
        pp.load(scene, arm="ur5e", robot_config=tmp_path / "robot.yaml")


@pytest.mark.long
def test_a_mass_is_read_from_the_sensor_while_the_ur5e_moves() -> None:
    run = pp.run(
        SCENARIOS / "bottle_and_table" / "scene.xml", measure="bottle.mass", arm="ur5e", fast=True
    )
    (converted,) = (leaf for leaf in run.trace.leaves if leaf.primitive == "Force2Mass")
    value, std = re.findall(r"\d\.\d+", converted.message)
    true = run.truth[pp.Parameter("bottle", "mass")][0]
    assert abs(float(value) - true) < float(std)
    assert run["bottle.mass"].verdict == "identified"
    assert "force/torque sensor" in run["bottle.mass"].method
