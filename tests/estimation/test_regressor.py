"""Regressor of an arm, against MuJoCo's inverse dynamics."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from moving_arm import inverse

from palpate.common.pose import components
from palpate.estimation.rigid_bodies import inertia_about_centre, parameters, placed_at, regressor
from palpate.robots.owner import load_description
from palpate.trace.recording import ChainLink

GRAVITY = np.array([0.0, 0.0, -9.81])


@pytest.mark.parametrize("name", ["fr3", "iiwa14"])
def test_the_regressor_equals_inverse_dynamics(name: str) -> None:
    """Random states; masses, centres and inertias of all links changed at random."""
    arm, rng = load_description(name), np.random.default_rng(3)
    chain = arm.nominal.chain
    assert chain is not None
    q, dq, ddq = rng.normal(size=(3, 20, 7))
    columns = regressor(chain, q, dq, ddq, GRAVITY)
    links = np.zeros((7, 10))
    for link in chain.links:
        links[link.joint] += parameters([link], np.array(chain.anchors[link.joint]))
    model = mujoco.MjModel.from_xml_path(str(arm.mjcf))
    described = np.einsum("njlp,lp->nj", columns, links)
    assert described == pytest.approx(inverse(model, q, dq, ddq), abs=1e-9)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for joint, hinge in enumerate(arm.joints):
        body = int(model.jnt_bodyid[model.joint(hinge).id])
        anchor = np.array(chain.anchors[joint])
        before = link_of(data, body)
        model.body_mass[body] *= rng.uniform(0.5, 1.5)
        model.body_ipos[body] += rng.normal(0.0, 0.03, 3)
        model.body_inertia[body] *= rng.uniform(0.5, 1.5, 3)
        mujoco.mj_forward(model, data)
        links[joint] += parameters([link_of(data, body)], anchor) - parameters([before], anchor)
    changed = np.einsum("njlp,lp->nj", columns, links)
    assert changed == pytest.approx(inverse(model, q, dq, ddq), abs=1e-9)
    assert not np.allclose(changed, described, atol=0.1)


def link_of(data: mujoco.MjData, body: int) -> ChainLink:
    axes = data.ximat[body].reshape(3, 3)
    tensor = components(axes @ np.diag(data.model.body_inertia[body]) @ axes.T)
    return ChainLink(0, data.model.body_mass[body], tuple(data.xipos[body]), tuple(tensor))  # type: ignore[arg-type]


def test_parameters_about_a_centre_are_those_of_the_body() -> None:
    centre = np.array([0.1, -0.2, 0.3])
    tensor = (0.02, 0.03, 0.04, 0.001, -0.002, 0.003)
    found = parameters([ChainLink(0, 2.0, tuple(centre), tensor)], np.zeros(3))
    assert found[1:4] / found[0] == pytest.approx(centre)
    assert components(inertia_about_centre(found)) == pytest.approx(tensor)
    moved = placed_at(centre) @ [2.0, 2e-6, 0.0, 0.0, *tensor]
    beside = parameters([ChainLink(0, 2.0, (0.1 + 1e-6, -0.2, 0.3), tensor)], np.zeros(3))
    assert moved == pytest.approx(beside, abs=1e-9), "a first moment is a centre that has moved"
