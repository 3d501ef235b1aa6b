from __future__ import annotations

import subprocess
import sys

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.common.pose import Pose
from palpate.robots.kinematics import (
    LIMIT_MARGIN,
    inverse_kinematics,
    model_without_fingers,
    too_far,
    within_joint_limits,
)
from palpate.robots.owner import load_description

ARM = load_description()
HOME = ARM.home
BASE = Pose.of((0.0, 0.0, 0.0))


def forward(q):
    """TCP pose in the base frame."""
    arm = model_without_fingers(ARM)
    data = mujoco.MjData(arm)
    data.qpos[:] = q
    mujoco.mj_kinematics(arm, data)
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, data.site("tcp").xmat)
    return Pose.of(data.site("tcp").xpos, quaternion)


@settings(max_examples=150, deadline=None)
@given(st.floats(0.35, 0.6), st.floats(-1.5, 1.5), st.floats(0.0, 0.5), st.floats(-1.5, 1.5))
def test_top_down_poses_in_front_of_the_arm_are_reached_within_tolerance_and_limits(
    radius, azimuth, z, yaw
):
    target = Pose.top_down((radius * np.cos(azimuth), radius * np.sin(azimuth), z), azimuth + yaw)
    q = inverse_kinematics(ARM, target, BASE)
    assert q is not None
    low, high = ARM.limits.q_min, ARM.limits.q_max
    assert (q >= low + LIMIT_MARGIN - 1e-9).all()
    assert (q <= high - LIMIT_MARGIN + 1e-9).all()
    reached = forward(q)
    assert reached.distance_to(target) < 0.001
    assert np.degrees(reached.angle_to(target)) < 0.5


@pytest.mark.parametrize(
    "position", [(1.2, 0, 0.3), (0.86, 0, 0.1), (0.0, 0.0, 0.4), (0.5, 0, 1.5), (50.0, 0, 0)]
)
def test_out_of_reach_is_none(position):
    assert inverse_kinematics(ARM, Pose.top_down(position, 0.0), BASE) is None


def test_no_configuration_is_too_far_and_the_quick_test_is_close():
    rng, limits = np.random.default_rng(0), ARM.limits
    q = rng.uniform(limits.q_min, limits.q_max, (300, 7))
    q[::2, 3] = -0.467  # both arms in one line
    assert not any(too_far(ARM, forward(each)) for each in q)
    # The sixth joint can be 0.719 m from the shoulder, and is 0.088 m nearer to it than the last.
    reach = [
        0.088 + np.sqrt(0.7194**2 - (0.333 - 0.2104 - 0.025) ** 2) + more for more in (0, 0.01)
    ]
    far = [too_far(ARM, Pose.top_down((x, 0.0, 0.025), 0.3)) for x in reach]
    assert far == [False, True]


def test_the_base_may_stand_anywhere():
    base = Pose.of((3.0, -2.0, 0.7), (np.cos(0.6), 0, 0, np.sin(0.6)))
    target = Pose.top_down((0.45, 0.1, 0.2), 0.3)
    here, there = (
        inverse_kinematics(ARM, target, BASE),
        inverse_kinematics(ARM, base @ target, base),
    )
    assert here is not None
    np.testing.assert_allclose(there, here, atol=1e-3)
    assert inverse_kinematics(ARM, target, base) is None


def test_the_ready_pose_gives_the_ready_configuration():
    q = inverse_kinematics(ARM, forward(HOME), BASE)
    np.testing.assert_allclose(q, HOME, atol=1e-3)


def test_the_elbow_is_up_and_the_posture_near_ready():
    for y in (-0.3, 0.0, 0.3):
        q = inverse_kinematics(ARM, Pose.top_down((0.45, y, 0.15), 0.0), BASE)
        assert q is not None
        arm = model_without_fingers(ARM)
        data = mujoco.MjData(arm)
        data.qpos[:] = q
        mujoco.mj_kinematics(arm, data)
        elbow, wrist = data.body("fr3_link4").xpos, data.body("fr3_link6").xpos
        assert elbow[2] > wrist[2]
        turned = np.add(HOME, [np.arctan2(y, 0.45), 0, 0, 0, 0, 0, 0])
        assert np.abs(q - turned)[[0, 2, 4]].max() < 0.2


def test_a_seed_chooses_the_solution():
    target = Pose.top_down((0.45, 0.0, 0.2), 0.0)
    default = inverse_kinematics(ARM, target, BASE)
    swung = inverse_kinematics(ARM, target, BASE, np.add(HOME, [0.6, 0, -0.6, 0, 0, 0, 0]))
    assert default is not None
    assert swung is not None
    assert abs(swung[0] - default[0]) > 0.1
    assert forward(swung).distance_to(target) < 0.001


def test_the_result_is_the_callers_own():
    target = Pose.top_down((0.4, 0.0, 0.2), 0.0)
    first = inverse_kinematics(ARM, target, BASE)
    assert first is not None
    first[:] = 0.0
    second = inverse_kinematics(ARM, target, BASE)
    assert second is not None
    assert second.any()


def test_solutions_respect_joint_limits():
    low, high = ARM.limits.q_min, ARM.limits.q_max
    assert within_joint_limits(ARM, np.array(HOME))
    assert within_joint_limits(ARM, (low + high) / 2)
    assert not within_joint_limits(ARM, high)
    assert not within_joint_limits(ARM, np.array([*HOME[:3], 0.0, *HOME[4:]]))
    assert not within_joint_limits(ARM, np.array([np.nan, *HOME[1:]]))


def test_importing_kinematics_does_not_load_mink():
    code = "import sys, palpate.robots.kinematics; assert 'mink' not in sys.modules and 'daqp' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
