"""How things look is no part of how they move."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from palpate.common.errors import InputError
from palpate.perception.dress import dress, look_catalogue, looks_in
from palpate.perception.stage import build_stage
from palpate.studies.scenarios.catalogue import scenario, scenarios

SCENE = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="3 3 .1" pos="0 0 -.7"/>
  <body name="table" pos="0 0 -.02"><geom type="box" size=".3 .4 .02" rgba=".8 .6 .4 1"/></body>
  <body name="cup" pos="0 0 .05"><freejoint/>
    <geom type="cylinder" size=".03 .05" mass=".2" rgba="0 0 1 1"/></body>
</worldbody><custom><text name="look:cup" data="cup milk"/><text name="note" data="x"/></custom></mujoco>"""


LOOKS = [body.name for body in look_catalogue().worldbody.bodies]
ROUND = ["bottle", "bowl", "candle", "cup", "mug", "thermometer", "tin"]


def worn(model: mujoco.MjModel) -> list[int]:
    """Geoms of looks."""
    return [g for g in range(model.ngeom) if model.geom(g).name.startswith("look:")]


def mesh_points(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> np.ndarray:
    """World positions (n, 3) of the vertices of a mesh."""
    mesh = model.mesh(int(model.geom_dataid[geom]))
    points = model.mesh_vert[mesh.vertadr[0] :][: mesh.vertnum[0]]
    return data.geom_xpos[geom] + points @ data.geom_xmat[geom].reshape(3, 3).T


def dressed(looks: dict[str, str]) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(SCENE)
    dress(spec, looks)
    return spec.compile()


@pytest.mark.parametrize("look", LOOKS)
@pytest.mark.parametrize("size", [".04 .03 .05", ".03 .04 .05"])
def test_a_look_fits_the_box_of_the_shapes_and_is_small(look: str, size: str) -> None:
    spec = mujoco.MjSpec.from_string(
        f"""<mujoco><worldbody><geom type="plane" size="3 3 .1" pos="0 0 -.7"/><body name="it" pos="0 0 .2">
        <geom type="box" size="{size}" pos=".1 0 0"/></body></worldbody></mujoco>"""
    )
    dress(spec, {"it": f"{look} SALT"})
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert model.nmeshvert < 9000
    drawn = np.concatenate([mesh_points(model, data, g) for g in worn(model)])
    assert 0.23 < drawn[:, 2].max() < 0.252
    assert (drawn[:, 2].min() < -0.69) == (look == "table")
    if look not in {*ROUND, "open_box"}:
        np.testing.assert_allclose(
            np.ptp(drawn[:, :2], axis=0), 2 * np.fromstring(size, sep=" ")[:2], rtol=0.15
        )


def test_a_look_is_found_where_file_names_lose_their_folders(tmp_path: Path) -> None:
    ball = Path(look_catalogue().modelfiledir, "ball.obj")
    (tmp_path / "own.obj").write_bytes(ball.read_bytes())
    spec = mujoco.MjSpec.from_string(
        """<mujoco><compiler strippath="true"/><asset><mesh file="far/own.obj"/></asset>
        <worldbody><body name="it"><geom type="mesh" mesh="own"/></body></worldbody></mujoco>"""
    )
    spec.modelfiledir = str(tmp_path)
    assert build_stage(spec, {"it": "ball"}).nmesh == 2


def test_words_choose_the_content_and_the_signs() -> None:
    coffee, salt = (dressed({"cup": f"mug {word}"}) for word in ("coffee", "salt"))
    assert len(worn(coffee)) == len(worn(salt)) + 1
    assert len(worn(dressed({"cup": "soap"}))) + 1 == len(worn(dressed({"cup": "soap SALT"})))
    assert dressed({"cup": "tin PEAS"}).ntex == 1


def test_looks_are_seen_and_neither_touched_nor_weighed() -> None:
    plain, model = mujoco.MjModel.from_xml_string(SCENE), dressed({"cup": "cup milk"})
    np.testing.assert_array_equal(model.body_mass, plain.body_mass)
    np.testing.assert_array_equal(model.body_inertia, plain.body_inertia)
    assert (model.nq, model.nv) == (plain.nq, plain.nv)
    added = worn(model)
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
    lowest = mesh_points(model, data, model.geom("look:table:1").id)
    assert lowest[:, 2].min() == pytest.approx(-0.7, abs=0.002)


@pytest.mark.parametrize("name", [n for n in scenarios() if scenario(n).settings().world])
def test_every_scenario_names_looks_that_there_are_for_bodies_that_it_has(name: str) -> None:
    world = scenario(name).settings().world
    spec = mujoco.MjSpec.from_file(str(world))
    here = {body.name for body in spec.bodies}
    for body, look in looks_in(spec).items():
        assert body in here
        assert look == "lab" or look.split()[0] in LOOKS
