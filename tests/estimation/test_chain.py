"""What an arm's links take to be moved, against another program's equations of motion."""

import numpy as np
import pytest

from palpate.common.pose import Pose
from palpate.estimation.rigid_bodies import own_motion
from palpate.robots.nominal import NominalArm
from palpate.robots.owner import load_description


def test_moving_the_links_takes_what_rigid_bodies_take():
    arm, random = load_description(), np.random.default_rng(0)
    q = arm.home + random.uniform(-0.5, 0.5, (20, 7))
    dq, ddq = random.uniform(-1.0, 1.0, (2, 20, 7))
    nominal = NominalArm(arm, Pose.of((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)), np.zeros(3))
    expected = nominal.kinematics(q, dq, ddq).inertia_torque
    assert np.abs(expected).max() > 1.0
    assert own_motion(arm.nominal.chain, q, dq, ddq) == pytest.approx(expected, abs=1e-3)


def test_an_arm_at_rest_takes_nothing():
    arm = load_description()
    still = np.zeros((1, 7))
    assert not own_motion(arm.nominal.chain, arm.home[None], still, still).any()
