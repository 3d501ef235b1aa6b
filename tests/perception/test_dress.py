"""How things look is no part of how they move."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from palpate.common.errors import InputError
from palpate.perception.dress import LOOKS, dress, looks_in, parts_of
from palpate.perception.meshes import LookBox
from palpate.perception.stage import build_stage
from palpate.studies.scenarios.catalogue import scenario, scenarios

SCENE = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="3 3 .1" pos="0 0 -.7"/>
  <body name="table" pos="0 0 -.02"><geom type="box" size=".3 .4 .02" rgba=".8 .6 .4 1"/></body>
  <body name="cup" pos="0 0 .05"><freejoint/>
    <geom type="cylinder" size=".03 .05" mass=".2" rgba="0 0 1 1"/></body>
</worldbody><custom><text name="look:cup" data="cup milk"/><text name="note" data="x"/></custom></mujoco>"""


def dressed(looks: dict[str, str]) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(SCENE)
    dress(spec, looks)
    return spec.compile()


@pytest.mark.parametrize("look", LOOKS)
def test_a_look_fits_the_box_of_the_shapes_and_is_small(look: str) -> None:
    fit = LookBox(
        np.array([0.1, 0.0, 0.2]), np.array([0.04, 0.03, 0.05]), (0.2, 0.4, 0.8), drop=0.7
    )
    parts = parts_of(f"{look} SALT", fit)
    points = np.concatenate([part.mesh.vertices for part in parts])
    assert len(points) < 9000
    assert 0.20 < points[:, 2].max() < 0.252
    for part in parts:
        assert part.mesh.faces.max() < len(part.mesh.vertices)


def test_looks_are_seen_and_neither_touched_nor_weighed() -> None:
    plain, model = mujoco.MjModel.from_xml_string(SCENE), dressed({"cup": "cup milk"})
    np.testing.assert_array_equal(model.body_mass, plain.body_mass)
    np.testing.assert_array_equal(model.body_inertia, plain.body_inertia)
    assert (model.nq, model.nv) == (plain.nq, plain.nv)
    added = [g for g in range(model.ngeom) if model.geom(g).name.startswith("look:")]
    assert added
    assert not model.geom_contype[added].any()
    assert not model.geom_conaffinity[added].any()
    assert (model.geom_group[added] == 2).all()
    own = [g for g in range(model.ngeom) if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_CYLINDER]
    assert model.geom_group[own] == 3, "what it collides with is not drawn"


def test_a_scene_says_how_its_bodies_look() -> None:
    assert looks_in(mujoco.MjSpec.from_string(SCENE)) == {"cup": "cup milk"}


def test_an_unknown_look_lists_those_there_are() -> None:
    with pytest.raises(InputError, match="bottle, bowl"):
        dressed({"cup": "cupp"})


def test_looks_of_bodies_that_are_not_there_are_left_out() -> None:
    assert dressed({"saucer": "cup"}).ngeom == 3


def test_staging_leaves_the_scene_as_it_is() -> None:
    spec = mujoco.MjSpec.from_string(SCENE)
    model = build_stage(spec)
    assert model.ngeom > spec.compile().ngeom == 3
    assert model.nlight
    assert list(spec.lights) == []


def test_a_table_stands_on_legs_down_to_the_floor() -> None:
    model = dressed({"table": "table"})
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    legs, mesh = model.geom("look:table:1").id, model.mesh("look:table:1")
    points = model.mesh_vert[mesh.vertadr[0] :][: mesh.vertnum[0]]
    lowest = data.geom_xpos[legs] + points @ data.geom_xmat[legs].reshape(3, 3).T
    assert lowest[:, 2].min() == pytest.approx(-0.7, abs=0.002)


@pytest.mark.parametrize("name", [n for n in scenarios() if scenario(n).settings().world])
def test_every_scenario_names_looks_that_there_are_for_bodies_that_it_has(name: str) -> None:
    world = scenario(name).settings().world
    spec = mujoco.MjSpec.from_file(str(world))
    here = {body.name for body in spec.bodies}
    for body, look in looks_in(spec).items():
        assert body in here
        assert look == "lab" or look.split()[0] in LOOKS
