"""The true arm is drawn around the nominal one, and the controller holds up the nominal one."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
from noises import ARM, HOME, model

from palpate.common.pose import Pose
from palpate.robots.description import pads_end
from palpate.robots.simulated.noise.model import Streams
from palpate.robots.simulated.noise.models import noise_models
from palpate.robots.simulated.noise.true_arm import TrueArm

BASE = Pose.of([0.1, 0.2, 0.3])


def truth(seed: int = 0, **figures: Any) -> TrueArm:
    return TrueArm(model(model=figures).model, Streams(seed))


def built(seed: int = 0, **figures: Any) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The true arm alone, at home."""
    spec = ARM.spec()
    truth(seed, **figures).build(spec, ARM)
    compiled = spec.compile()
    data = mujoco.MjData(compiled)
    data.qpos[:7] = ARM.home
    mujoco.mj_forward(compiled, data)
    return compiled, data


def place(data: mujoco.MjData) -> np.ndarray:
    return data.site(ARM.tcp).xpos.copy()


@pytest.mark.parametrize("noise", ["none", "datasheet", "hardware"])
def test_native_compensation_holds_the_nominal_weight(noise: str) -> None:
    figures = (
        noise_models()
        .load(noise)
        .model.model_copy(
            update={
                "joint_offset": model().model.joint_offset,
                "link_length": model().model.link_length,
            }
        )
    )
    spec = ARM.spec()
    TrueArm(figures, Streams(1)).build(spec, ARM)
    compiled = spec.compile()
    data = mujoco.MjData(compiled)
    data.qpos[:7] = ARM.home
    mujoco.mj_forward(compiled, data)
    nominal = HOME.gravity_torque[0]
    assert data.qfrc_gravcomp[:7] == pytest.approx(nominal, abs=1e-9)
    error = np.abs(data.qfrc_bias[:7] - nominal).max()
    assert error < 1e-9 if noise == "none" else 0.01 < error < 2.0


def test_links_weigh_more_or_less_by_their_size() -> None:
    nominal = built()[0].body_mass.sum()
    fixed = built(link_mass={"fixed": [0, 0, 0, 0.1, 0, 0, 0]})[0]
    link = ARM.spec().joint(ARM.joints[3]).parent.mass
    assert fixed.body_mass.sum() - nominal == pytest.approx(0.1 * link)


def test_the_hand_carries_unmodelled_mass() -> None:
    more = built(hand_mass={"fixed": 0.05})
    assert more[0].body_mass.sum() - built()[0].body_mass.sum() == pytest.approx(0.05)
    extra = more[1].qfrc_bias[:7] - HOME.gravity_torque[0]
    hand = more[1].body(f"{ARM.hand.body}_rest").xipos
    arm = hand - more[1].xanchor[1]
    assert extra[1] == pytest.approx(-0.05 * 9.81 * arm[0], abs=0.02)


def test_an_encoder_that_is_off_puts_the_tool_elsewhere() -> None:
    offset = 1e-3
    data = built(joint_offset={"fixed": [offset, 0, 0, 0, 0, 0, 0]})[1]
    nominal = HOME.pose_world_tcp[0, :3]
    turned = np.cross([0, 0, offset], nominal)
    assert place(data) - nominal == pytest.approx(turned, abs=1e-6)


def test_a_longer_link_puts_the_tool_elsewhere() -> None:
    data = built(link_length={"fixed": [1e-3, 0, 0, 0, 0, 0, 0]})[1]
    assert place(data) - HOME.pose_world_tcp[0, :3] == pytest.approx([0, 0, 1e-3], abs=1e-9)


def test_pads_end_where_they_are_worn_to() -> None:
    def end(**figures: Any) -> float:
        compiled, _ = built(**figures)
        return pads_end(compiled, ARM.hand)

    assert end() == pytest.approx(ARM.tip)
    assert end(tip_offset={"fixed": 5e-4}) == pytest.approx(ARM.tip + 5e-4, abs=2e-6)
    ends = [end(tip_offset=2e-4, seed=seed) for seed in range(40)]
    assert np.std(ends) == pytest.approx(2e-4, rel=0.3)


def test_pads_stand_aside() -> None:
    sides = []
    for figures in ({}, {"tip_lateral": {"fixed": [1e-3, 2e-3]}}):
        compiled, data = built(**figures)
        fingers = {compiled.joint(name).bodyid[0] for name in ARM.hand.fingers}
        geoms = [i for i in range(compiled.ngeom) if compiled.geom_bodyid[i] in fingers]
        sides.append(data.geom_xpos[geoms].copy())
    shift = sides[1] - sides[0]
    tool = built()[1].body(ARM.hand.body).xmat.reshape(3, 3)
    assert shift == pytest.approx(np.tile(tool @ [1e-3, 2e-3, 0], (len(shift), 1)), abs=1e-9)


def test_the_base_is_displaced_and_tilted() -> None:
    assert truth().base(BASE) is BASE
    moved = truth(base_position={"fixed": [0, 0, 2e-3]}).base(BASE)
    assert moved.position == pytest.approx([0.1, 0.2, 0.302])
    leaning = truth(base_tilt={"fixed": [0, 0.01]}).base(BASE)
    assert leaning.rotation[:, 2] == pytest.approx([np.sin(0.01), 0, np.cos(0.01)], abs=1e-9)
    turned = truth(base_yaw={"fixed": 0.02}).base(BASE)
    assert turned.rotation[:, 0] == pytest.approx([np.cos(0.02), np.sin(0.02), 0], abs=1e-9)


def test_gravity_differs_from_what_is_assumed() -> None:
    true = truth(gravity={"fixed": 0.02}).gravity(np.array([0, 0, -9.81]))
    assert true == pytest.approx([0, 0, -9.83])


def test_only_errors_hidden_from_the_encoders_displace_the_arm() -> None:
    assert not TrueArm(noise_models().load("datasheet").model, Streams(0)).askew
    assert TrueArm(noise_models().load("hardware").model, Streams(0)).askew
