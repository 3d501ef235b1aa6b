from __future__ import annotations

import numpy as np
import pytest

from palpate.common.pose import Pose
from palpate.robots.nominal import wrench
from palpate.robots.owner import load_description
from palpate.robots.pace import configuration, jacobian, mistaken_force, unexplained_torque

ARM = load_description()
DOWN = np.array([0.0, 1.0, 0.0, 0.0])


def bent(x: float, z: float) -> np.ndarray:
    return configuration(ARM, Pose(np.array([x, 0.0, z]), DOWN))


@pytest.mark.parametrize("q", [ARM.home, bent(0.5, 0.2), bent(0.62, 0.55)])
def test_no_torque_that_errors_explain_looks_like_more(q):
    torques = np.random.default_rng(0).normal(size=(2000, 7))
    torques *= unexplained_torque(ARM) / np.linalg.norm(torques, axis=1)[:, None]
    forces = [np.linalg.norm(wrench(jacobian(ARM, q), torque)[:3]) for torque in torques]
    assert 0.8 * mistaken_force(ARM, q) < max(forces) <= mistaken_force(ARM, q) * (1 + 1e-9)


def test_a_stretched_arm_cannot_feel_what_a_bent_one_does():
    assert mistaken_force(ARM, bent(0.45, 0.3)) < ARM.limits.free_force
    assert mistaken_force(ARM, bent(0.62, 0.55)) > 1.5 * ARM.limits.free_force
