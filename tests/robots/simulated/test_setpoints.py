"""The reported arm does as it is told, wherever the true one is."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from palpate.common.pose import Pose
from palpate.robots.owner import load_description
from palpate.robots.simulated.robot import MujocoRobot

ARM = load_description()
BASE = Pose.of([0, 0, 0])
ASKEW = """
model: {joint_offset: 3e-3, link_length: 1e-3, base_position: 5e-3, base_tilt: 0.01, gravity: 0.05}
pose: {repeatability: 1e-3}
"""
SOFT = "model: {joint_compliance: {fixed: 2e-4}}"


def robot(folder: Path, text: str, inside: str = "", seed: int = 1) -> MujocoRobot:
    path = folder / "noise.yaml"
    path.write_text(text)
    world = mujoco.MjSpec.from_string(f"<mujoco><worldbody>{inside}</worldbody></mujoco>")
    return MujocoRobot(world, BASE, ARM, noise=str(path), seed=seed)


def rest(arm: MujocoRobot, way: tuple[float, float, float], seconds: float = 2.5) -> None:
    start = arm.state.pose_world_tcp
    arm.move_pose(start.translate(np.array(way)), 0.1)
    for _ in range(round(seconds / 0.02)):
        arm.advance(0.02)


@pytest.mark.parametrize("text", [ASKEW, SOFT])
def test_the_reported_arm_reaches_its_target(tmp_path: Path, text: str) -> None:
    arm = robot(tmp_path, text)
    rest(arm, (0.05, 0.05, -0.05))
    state = arm.state
    assert state.pose_world_tcp.distance_to(state.target_world_tcp) < 5e-4
    assert arm.world.true_tcp().distance_to(state.pose_world_tcp) > 1e-3
    arm.move_joints(ARM.home)
    arm.advance(1.5)
    assert arm.state.q == pytest.approx(ARM.home, abs=2e-4)


def test_nothing_jerks_when_a_motion_begins(tmp_path: Path) -> None:
    perfect, askew = robot(tmp_path, "extends: none"), robot(tmp_path, ASKEW)
    peaks: list[float] = []
    for arm in (perfect, askew):
        rest(arm, (0.0, 0.03, 0.0), 1.5)
        rest(arm, (0.0, 0.0, -0.03), 1.5)
        felt = arm.drain().wrench[:, :3]
        peaks.append(float(np.linalg.norm(felt - felt[-1], axis=1).max()))
    assert peaks[1] < peaks[0] + 1.0


def test_compliant_joints_sag_behind_the_encoders(tmp_path: Path) -> None:
    arm = robot(tmp_path, SOFT)
    sag = arm.world.true_tcp().position - arm.state.pose_world_tcp.position
    torque = arm.world.true_gravity_torque()
    assert arm.state.q == pytest.approx(ARM.home + 2e-4 * torque)
    assert sag[2] < -1e-3


def test_compliant_pads_let_the_arm_on_in_proportion_to_the_force(tmp_path: Path) -> None:
    soft = 2e-4
    here = robot(tmp_path, "extends: none").state.pose_world_tcp.position
    top = here[2] - ARM.tip - 0.002
    table = f'<geom type="box" size=".1 .1 .02" pos="{here[0]} 0 {top - 0.02}"/>'
    felt: list[tuple[float, float]] = []
    arm = robot(tmp_path, f"model: {{pad_compliance: {{fixed: {soft}}}}}", table)
    arm.close_gripper()
    arm.advance(1.0)
    start = arm.state.pose_world_tcp
    for deeper in (0.004, 0.008):
        arm.move_pose(start.translate(np.array([0.0, 0.0, -deeper])), 0.02)
        for _ in range(75):
            arm.advance(0.02)
        felt.append((float(arm.state.pose_world_tcp.position[2]), -float(arm.state.wrench[2])))
    (z0, f0), (z1, f1) = felt
    assert f1 > f0 + 3.0
    assert (z0 - z1) / (f1 - f0) == pytest.approx(soft, rel=0.05)
    assert z0 + soft * f0 - ARM.tip == pytest.approx(top, abs=5e-5), "carried back, the surface"


def test_lost_samples_do_not_update_the_state(tmp_path: Path) -> None:
    arm = robot(tmp_path, "acquisition: {dropped: {rate: 5, length: 0.04}}")
    arm.move_joints(ARM.home + 0.2)
    ages: list[float] = []
    for _ in range(100):
        arm.advance(0.02)
        ages.append(arm.state.t - arm.state.stamp)
    samples = arm.drain()
    gaps = np.diff(samples.t)
    assert 0.03 < gaps.max() < 0.1
    assert 0.01 < max(ages) < 0.1
    assert gaps.min() == pytest.approx(0.005)
    assert np.isfinite(samples.wrench).all()


def test_a_fast_clock_sets_the_robots_time(tmp_path: Path) -> None:
    arm = robot(tmp_path, "acquisition: {clock: {fixed: 0.01}}")
    for _ in range(50):
        arm.advance(0.02)
    assert arm.state.t == pytest.approx(1.0, abs=0.006)
    assert arm.world.t == pytest.approx(1.0 / 1.01, abs=0.006)
    assert arm.drain().t[-1] == pytest.approx(arm.state.stamp)


def test_the_reported_opening_has_its_own_offset(tmp_path: Path) -> None:
    arm = robot(tmp_path, "model: {finger_width: {fixed: 1e-3}}")
    arm.advance(0.3)
    true = sum(float(arm.world.data().joint(f"robot/{name}").qpos[0]) for name in ARM.hand.fingers)
    assert arm.state.width - true == pytest.approx(1e-3, abs=1e-6)
    assert arm.state.width == pytest.approx(ARM.hand.opening, abs=2e-4), "its servo is led by it"
    assert arm.drain().width[-1] == pytest.approx(arm.state.width)
