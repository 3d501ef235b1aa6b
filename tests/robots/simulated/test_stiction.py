"""What holds better than it slides."""

import mujoco
import pytest

from palpate.errors import InputError
from palpate.robots.simulated.stiction import declared

STATIC, DYNAMIC = 0.5, 0.3
HALF = 0.03
WORLD = """
<mujoco>
  <option timestep="0.001"/>
  <worldbody>
    <geom name="table" type="box" size="1 1 .02" pos="0 0 -.02"/>
    <body name="{name}" pos="0 0 {z}">
      <freejoint/>
      <geom type="box" size=".03 .03 {half}" mass=".2" friction="{dynamic}" priority="1"/>
    </body>
  </worldbody>
  <custom><numeric name="static_friction_box" data="{static}"/></custom>
</mujoco>"""


def a_box(z: float = HALF - 1e-4, speed: float = 0.0, name: str = "box", static: float = STATIC):
    """A box `z` m up that moves along x, at m/s."""
    text = WORLD.format(name=name, z=z, half=HALF, dynamic=DYNAMIC, static=static)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qvel[0] = speed
    mujoco.mj_forward(model, data)
    return model, data


def coefficient(model: mujoco.MjModel) -> float:
    return float(model.geom_friction[1, 0])


@pytest.mark.parametrize(("speed", "holds"), [(0.0, STATIC), (0.04, DYNAMIC)])
def test_what_rests_holds_better_than_what_slides(speed, holds):
    model, data = a_box(speed=speed)
    (stiction,) = declared(model)
    stiction.apply(model, data)
    assert coefficient(model) == holds


def test_what_hops_as_it_slides_lands_sliding():
    model, data = a_box(speed=0.04)
    assert data.ncon > 0
    (stiction,) = declared(model)
    stiction.apply(model, data)
    data.qpos[2] += 0.01
    mujoco.mj_forward(model, data)
    assert data.ncon == 0
    stiction.apply(model, data)
    assert coefficient(model) == DYNAMIC


def test_what_lands_at_rest_holds():
    model, data = a_box(speed=0.04)
    (stiction,) = declared(model)
    stiction.apply(model, data)
    data.qvel[0] = 0.0
    mujoco.mj_forward(model, data)
    stiction.apply(model, data)
    assert coefficient(model) == STATIC


@pytest.mark.parametrize(
    ("changes", "named"), [({"name": "tin"}, "tin"), ({"static": 0.1}, "must not be less")]
)
def test_what_no_pair_of_surfaces_is_like_is_refused(changes, named):
    model, _ = a_box(**changes)
    with pytest.raises(InputError, match=named):
        declared(model)
