"""An arm's MJCF with its identified dynamics, read back by MuJoCo."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from moving_arm import COULOMB, fourier, inverse, recorded

import palpate as pp
from palpate.common.errors import InputError
from palpate.robots.owner import load_description
from palpate.twin.arm import physical


@pytest.mark.parametrize("name", ["fr3", "iiwa14"])
def test_the_written_arm_moves_as_it_was_recorded(name: str, tmp_path: Path) -> None:
    arm = load_description(name)
    dynamics = pp.dynamics(recorded(arm, 1.3), arm=name)
    assert dynamics.hand is not None
    written = dynamics.save(tmp_path / "arm.xml")
    assert written[0] == tmp_path / "arm.xml"
    before = mujoco.MjModel.from_xml_path(str(arm.mjcf))
    after = mujoco.MjModel.from_xml_path(str(written[0]))
    joints = [after.joint(joint) for joint in arm.joints]
    losses = np.array([joint.frictionloss[0] for joint in joints])
    assert losses == pytest.approx(dynamics.coulomb.value, abs=2e-2)
    assert losses == pytest.approx(COULOMB, rel=0.35)
    for joint, i in zip(joints, dynamics.armature.value, strict=True):
        assert joint.armature[0] == before.joint(joint.name).armature[0], "not seen: as it was"
        assert abs(i) < 0.1
    hand = after.body(arm.hand.body).id
    assert after.body_subtreemass[hand] == pytest.approx(dynamics.hand.mass, abs=1e-3)
    _, q, dq, ddq = fourier(2.0, arm)
    true = mujoco.MjModel.from_xml_path(str(arm.mjcf))
    for body in range(hand, true.nbody):
        true.body_mass[body] *= 1.3 / before.body_subtreemass[hand]
    errors = [
        np.abs(inverse(model, q, dq, ddq) - inverse(true, q, dq, ddq)) for model in (after, before)
    ]
    assert errors[0].mean() < 0.25 * errors[1].mean(), "the hand is heavier than described"


def test_an_arm_is_not_overwritten(tmp_path: Path) -> None:
    dynamics = pp.dynamics(recorded(load_description("fr3"), 0.76, seconds=10.0))
    (tmp_path / "arm.xml").write_text("mine")
    with pytest.raises(InputError, match="exists already"):
        dynamics.save(tmp_path / "arm.xml")


def test_physically_impossible_bodies_are_detected() -> None:
    assert physical(np.diag([1.0, 2.0, 2.5]))
    assert not physical(np.diag([1.0, 2.0, 3.5]))
    assert not physical(np.diag([-0.1, 2.0, 2.0]))
