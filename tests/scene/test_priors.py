"""Beliefs before touch, and hidden truths drawn around them."""

from __future__ import annotations

import pytest

from palpate.common.parameter import Parameter
from palpate.estimation.quantities.mass import PRIOR_MASS
from palpate.execution.simulated_cell import draw_truth
from palpate.scene.load import parse_scene

TEXT = """<mujoco><worldbody>
  <geom name="table" type="box" pos="0.5 0 ?" size="0.3 0.4 0.02"/>
  <geom name="shelf" type="box" pos="0.5 0.8 ?" size="0.2 0.2 0.02"/>
  <body name="can" pos="0.5 0 0.45"><freejoint/><geom type="cylinder" size="0.03 0.05"/></body>
  <body name="rod" pos="? ? 0.42"><freejoint/><inertial pos="0 0 ?" mass="0.2" diaginertia="? ? ?"/>
    <geom type="box" size="0.1 0.01 0.02" friction="0.5"/></body>
</worldbody></mujoco>"""


def test_priors_are_plausible() -> None:
    scene = parse_scene(TEXT)
    assert set(scene.priors) == set(scene.missing)
    assert scene.priors[Parameter("can", "mass")] == pytest.approx(
        (500 * 3.14159 * 0.03**2 * 0.1,), rel=1e-3
    )
    assert scene.priors[Parameter("can", "friction")] == (0.5,)
    assert scene.priors[Parameter("table", "height")] == pytest.approx((0.4,))
    assert scene.priors[Parameter("rod", "com")] == pytest.approx((0, 0, 0), abs=1e-9)
    assert scene.priors[Parameter("rod", "inertia")][:3] == pytest.approx(
        (
            0.2 / 12 * (0.02**2 + 0.04**2),
            0.2 / 12 * (0.2**2 + 0.04**2),
            0.2 / 12 * (0.2**2 + 0.02**2),
        )
    )


def test_masses_stay_within_bounds() -> None:
    grain = '<body name="g" pos="0.5 0 0"><freejoint/><geom size="0.001"/></body>'
    block = '<body name="b" pos="0.5 0 0"><freejoint/><geom size="0.5"/></body>'
    priors = parse_scene(f"<mujoco><worldbody>{grain}{block}</worldbody></mujoco>").priors
    assert (priors[Parameter("g", "mass")], priors[Parameter("b", "mass")]) == (
        (PRIOR_MASS[0],),
        (PRIOR_MASS[1],),
    )


def test_truth_is_drawn_for_everything_missing_and_repeats_with_its_seed() -> None:
    scene = parse_scene(TEXT)
    assert draw_truth(scene, 3) == draw_truth(scene, 3)
    assert draw_truth(scene, 3) != draw_truth(scene, 4)
    for seed in range(20):
        truth = draw_truth(scene, seed)
        assert set(truth) == set(scene.missing)
        assert 0.397 <= truth[Parameter("table", "height")][0] <= 0.4, (
            "things must not start inside the table"
        )
        assert PRIOR_MASS[0] <= truth[Parameter("can", "mass")][0] <= PRIOR_MASS[1]
        assert 0.2 < truth[Parameter("can", "friction")][0] < 0.8


def test_a_drawn_world_compiles_with_the_truth_in_it() -> None:
    scene = parse_scene(TEXT)
    truth = draw_truth(scene, 1)
    model = scene.spec(truth).compile()
    assert model.body("can").mass[0] == pytest.approx(truth[Parameter("can", "mass")][0], rel=1e-5)
    assert model.body("rod").ipos == pytest.approx(truth[Parameter("rod", "com")], rel=1e-5)
    assert model.body("rod").pos[:2] == pytest.approx(truth[Parameter("rod", "position")], rel=1e-5)
    assert model.geom("table").pos[2] + 0.02 == pytest.approx(
        truth[Parameter("table", "height")][0], rel=1e-5
    )
